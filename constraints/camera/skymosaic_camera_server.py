"""Serves rings and painter of a camera build to one client at a time over TCP, on loopback alone. Needs numpy.

Requests and answers are lines of JSON; arrays follow an answer as NumPy's archive. `skymosaic_camera.Camera` is the
client. When it goes away, or is silent for too long, rings and painter are switched off, and the next one may begin.
"""

import contextlib
import io
import json
import math
import socketserver

import numpy as np
from skymosaic_painter import Painter
from skymosaic_rings import RingReader
from skymosaic_server import Client, ClientGoneError

MAX_FRAME_SECONDS = 30


class CameraSession(socketserver.BaseRequestHandler):
    """Rings and painter for one client; ``server.accelerator`` is the bus. An empty line ends it."""

    def handle(self):
        """Answer requests; an error is sent as one line, and ends the session."""
        self.rings = self.painter = None
        client = Client(self.request, self.server.idle_seconds, math.inf)
        try:
            while line := client.line():
                told, arrays = self._answer(**json.loads(line))
                archive = io.BytesIO()
                np.savez(archive, **arrays)
                client.answer({**told, "bytes": archive.tell()}, archive.getvalue())
        except ClientGoneError:
            print("the client has gone")
        # No error of a client or of the board may end the server or get lost.
        except Exception as error:
            with contextlib.suppress(ClientGoneError):
                client.answer({"error": str(error) or type(error).__name__})
        finally:
            for part in (self.painter, self.rings):
                if part is not None:
                    part.close()

    def _answer(self, call, **request):
        if call == "start" and self.rings is None:
            return self._start(**request)
        if self.rings is None or call not in ("frame", "counts", "picture", "anchor", "place"):
            raise ValueError(f"the request is malformed: {call!r:.40} is no call at this time")
        if call == "frame":
            return self._frame(**request)
        if call == "counts":
            return self.rings.counts() | (self.painter.counts() if self.painter else {}), {}
        if self.painter is None:
            raise ValueError("nothing is painted; start the session with a painter")
        if call == "picture":
            return {}, {"picture": self.painter.picture()}
        pose = np.array(request["pose"], np.float64)
        return {"counts": bool(getattr(self.painter, call)(request["number"], pose))}, {}

    def _start(self, settings, rings, painter):
        self.rings = RingReader(self.server.accelerator, settings, **rings)
        if painter:
            self.painter = Painter(self.rings.registers, **painter)
            self.painter.start()
        return {}, {}

    def _frame(self, seconds):
        frame = self.rings.next_frame(min(seconds, MAX_FRAME_SECONDS))
        if frame is None:
            return {"number": 0}, {}
        if self.painter is not None:
            self.painter.follow(frame)
        homography = [] if frame.homography is None else [frame.homography]
        # Copies: the slots may be written when they are released.
        arrays = {"features": frame.features.copy(), "matches": frame.matches.copy()}
        arrays["homography"] = np.array(homography)
        self.rings.release()
        return {"number": frame.number, "good": frame.good}, arrays
