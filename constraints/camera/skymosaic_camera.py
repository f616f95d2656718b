"""Frames and pictures of a camera build on a board, for a program elsewhere. Needs Python 3.10 and numpy alone.

    with Camera(settings, painter={"columns": 64, "rows": 48}) as camera:
        for frame in camera:
            if it is known where an earlier frame lies:
                camera.anchor(its number, pose)
        show(camera.picture())

The board runs ``serve_camera.py`` of the same export. From another machine, use an SSH tunnel.
"""

import contextlib
import io
import json
import socket
import types

import numpy as np

PORT = 7021
TIMEOUT_SECONDS = 60
FRAME_SECONDS = 5.0


class CameraError(Exception):
    """What the board says, or that it does not answer; the session is over then."""


class Camera:
    """A session: rings and painter are set up for it, and switched off at its end.

    Parameters
    ----------
    settings : dict
        As for `skymosaic_rings.RingReader`; ``rings`` has its other parameters.
    painter : dict
        Parameters of `skymosaic_painter.Painter`; without any, nothing is painted.
    address : (str, int)
        Of the server, or of the near end of a tunnel.
    """

    def __init__(self, settings, painter=None, rings=None, address=("127.0.0.1", PORT)):
        try:
            self._socket = socket.create_connection(address, TIMEOUT_SECONDS)
        except OSError as error:
            raise CameraError(f"no server at {address[0]}:{address[1]}: {error}; run serve_camera.py") from None
        self._received = self._socket.makefile("rb")
        try:
            self._call("start", settings=settings, painter=painter or {}, rings=rings or {})
        except CameraError:
            self.__exit__()
            raise

    def __enter__(self):
        """Return the session itself."""
        return self

    def __exit__(self, *_):
        """End the session, and wait until the board has switched rings and painter off."""
        with self._socket, self._received, contextlib.suppress(OSError):
            self._socket.sendall(b"\n")
            self._received.read()

    def __iter__(self):
        """Iterate over the frames until none has come for `FRAME_SECONDS`.

        They have ``number``, ``good``, and copies of ``features``, ``matches`` and ``homography``, as
        `skymosaic_rings.RingFrame`.
        """
        while (frame := self._call("frame", seconds=FRAME_SECONDS)).number:
            frame.homography = frame.homography[0] if frame.homography.size else None
            yield frame

    def anchor(self, number, pose):
        """Say where a frame lies that may be past; returns whether it counts (`skymosaic_painter.Painter.anchor`)."""
        return self._call("anchor", number=number, pose=np.asarray(pose, np.float64).tolist()).counts

    def place(self, number, pose):
        """Set the pose of a frame that has just come, as `skymosaic_painter.Painter.place`."""
        return self._call("place", number=number, pose=np.asarray(pose, np.float64).tolist()).counts

    def picture(self):
        """Copy what is shown: a uint8 array (height, width, 4) of blue, green, red, weight."""
        return self._call("picture").picture

    def counts(self):
        """Read the counters of rings and painter."""
        return vars(self._call("counts"))

    def _call(self, call, **request):
        try:
            self._socket.sendall(json.dumps({"call": call, **request}).encode() + b"\n")
            told = json.loads(self._received.readline())
            arrays = self._received.read(told.pop("bytes", 0))
            told |= np.load(io.BytesIO(arrays)) if arrays else {}
        except (OSError, ValueError):
            raise CameraError("the board does not answer; do serve_camera.py and the tunnel to it run?") from None
        if "error" in told:
            raise CameraError(told["error"])
        return types.SimpleNamespace(**told)
