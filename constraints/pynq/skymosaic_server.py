"""Serves the accelerator to one client at a time over TCP. Needs the standard library, numpy and the driver.

A request is a line of JSON. If it is valid, the server answers with an empty JSON object, the client sends the bytes
of the frames, and the server answers with a line of JSON and the bytes of the packets. There is no authentication:
use a private network only.
"""

import json
import socketserver

import numpy as np
import skymosaic_map as the_map
from skymosaic_driver import AcceleratorError

MAX_HEADER_BYTES = 65536
MAX_FRAMES = 64
CLIENT_TIMEOUT_SECONDS = 30


class Handler(socketserver.StreamRequestHandler):
    """One request, one answer."""

    timeout = CLIENT_TIMEOUT_SECONDS

    def handle(self):
        """Read, check, run, answer. An error is sent to the client as one line, and the server goes on."""
        try:
            frames, settings, hold_reference = self._request()
            results = self.server.accelerator.run(frames, settings, hold_reference)
        except (AcceleratorError, ValueError) as error:
            self._answer({"error": str(error)})
            return
        except OSError:
            return
        parts = [
            part for frame in results for part in (frame.features, frame.status, frame.matches, frame.match_status)
        ]
        self._answer({"lengths": [part.nbytes for part in parts]}, *(part.tobytes() for part in parts))

    def _request(self):
        header = self.rfile.readline(MAX_HEADER_BYTES)
        try:
            request = json.loads(header)
            shape, count = tuple(map(int, request["shape"])), int(request["frames"])
            settings = {name: int(request["settings"][name]) for name in the_map.REQUESTED}
            hold_reference = bool(request["hold_reference"])
        except (KeyError, TypeError, ValueError) as error:
            raise ValueError(f"the request is malformed: {error}") from None
        # Before the frames are sent: a client that is still sending would not read the error.
        self._check(shape, count, settings)
        self._answer({})
        length = int(np.prod(shape))
        return [self._frame(length).reshape(shape) for _ in range(count)], settings, hold_reference

    def _check(self, shape, count, settings):
        accelerator = self.server.accelerator
        if not 1 <= count <= MAX_FRAMES:
            raise ValueError(f"{count} frames requested; the server takes 1 to {MAX_FRAMES} at a time")
        if len(shape) not in (2, 3) or shape[2:] not in ((), (3,)):
            raise ValueError(f"frames have shape {shape}; it must be (height, width) or (height, width, 3)")
        for name, size_px, built_px in (
            ("width_px", shape[1], accelerator.max_width_px),
            ("height_px", shape[0], accelerator.max_height_px),
        ):
            smallest_px, _ = the_map.WRITABLE[name]
            if not smallest_px <= size_px <= built_px:
                extent = "wide" if name == "width_px" else "high"
                raise ValueError(f"frames are {size_px} px {extent}; {smallest_px} to {built_px} were built")
        if (settings["width_px"], settings["height_px"]) != (shape[1], shape[0]):
            raise ValueError("width_px and height_px differ from the frames' shape")

    def _frame(self, length_bytes):
        data = self.rfile.read(length_bytes)
        if len(data) != length_bytes:
            raise ValueError(f"a frame ended after {len(data)} of {length_bytes} bytes")
        return np.frombuffer(data, np.uint8)

    def _answer(self, header, *parts):
        self.wfile.write(json.dumps(header).encode() + b"\n" + b"".join(parts))


class Server(socketserver.TCPServer):
    """Serves one client after the other, because there is only one accelerator."""

    allow_reuse_address = True

    def __init__(self, address, accelerator):
        self.accelerator = accelerator
        super().__init__(address, Handler)
