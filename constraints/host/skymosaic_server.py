"""Serves the accelerator to one client at a time over TCP, on loopback alone. Needs Python 3.10 and numpy.

A request is a line of JSON. If it is valid, the server answers with a JSON object, the client sends the bytes of the
frames, and the server answers with a line of JSON and the bytes of the packets.

Another machine reaches it through an SSH tunnel, which checks who comes and encrypts what is sent.
"""

import argparse
import contextlib
import io
import ipaddress
import json
import socket
import socketserver
import time

import numpy as np
import skymosaic_map as register_map
from skymosaic_registers import AcceleratorError

PORT = 7020
TUNNEL_HELP = """Only programs on this machine reach the server. From another one, use an SSH tunnel:
ssh -N -L {0}:localhost:{0} BOARD"""
MAX_LINE_BYTES = 65536
MAX_FRAMES = 64
IDLE_SECONDS = 30
REQUEST_SECONDS = 120
"""Total time that the server waits for one client, since all others wait meanwhile."""


class ClientGoneError(Exception):
    """The client closed the connection, or was too slow, so no answer can be sent."""


class Client(io.RawIOBase):
    """The connection to a client, with limits on the time spent waiting for it.

    Parameters
    ----------
    connection : socket
    idle_seconds, request_seconds : float
        Limits for the next bytes, and for all bytes of a request; the accelerator's time does not count.
    """

    def __init__(self, connection, idle_seconds, request_seconds):
        super().__init__()
        self._connection = connection
        self._idle_seconds = idle_seconds
        self._seconds_left = request_seconds
        self._received = io.BufferedReader(self)

    def line(self):
        """The next line, without its end."""
        line = self._received.readline(MAX_LINE_BYTES + 1).removesuffix(b"\n")
        if len(line) > MAX_LINE_BYTES:
            raise ValueError(f"the request is malformed: its line is longer than {MAX_LINE_BYTES} bytes")
        return line

    def bytes(self, length):
        """The next ``length`` bytes, in a new array."""
        data = np.empty(length, np.uint8)
        if self._received.readinto(data) < length:
            raise ClientGoneError
        return data

    def readable(self):
        """Whether bytes can be read, for the buffer."""
        return True

    def readinto(self, buffer):
        """Receive some bytes, for the buffer."""
        return self._wait_for(self._connection.recv_into, buffer)

    def answer(self, header, *parts):
        """Send a line of JSON and bytes."""
        for part in (json.dumps(header).encode() + b"\n", *parts):
            self._wait_for(self._connection.sendall, part)

    def _wait_for(self, call, argument):
        # Never 0, which would mean not to wait at all.
        self._connection.settimeout(max(min(self._idle_seconds, self._seconds_left), 0.001))
        started = time.monotonic()
        try:
            return call(argument)
        except OSError:
            raise ClientGoneError from None
        finally:
            self._seconds_left -= time.monotonic() - started


class Handler(socketserver.BaseRequestHandler):
    """One request, one answer."""

    def handle(self):
        """Serve a request; an error is sent to the client as one line, and the server continues."""
        server = self.server
        self.client = Client(self.request, server.idle_seconds, server.request_seconds)
        self.frames_left, self.frame_bytes = 0, 0
        try:
            self._serve()
        except ClientGoneError:
            return
        # No error of the accelerator's software may end the server or get lost.
        except Exception as error:
            self._refuse(str(error) or type(error).__name__)

    def _serve(self):
        shape, count, settings, hold_reference, rules, estimates = self._parse(self.client.line())
        # Before the frames arrive: a client that is still sending would not read the error.
        self._check(shape, count, settings, rules)
        self.client.answer({})
        self.frames_left, self.frame_bytes = count, int(np.prod(shape))
        frames = (self._frame(shape) for _ in range(count))
        results = self.server.accelerator.run(frames, settings, hold_reference)
        parts = []
        for frame in results:
            parts += [frame.features, frame.status, frame.matches, frame.match_status]
            parts += [frame.homography] if estimates else []
        self.client.answer({"lengths": [part.nbytes for part in parts]}, *(part.tobytes() for part in parts))

    def _parse(self, line):
        try:
            request = json.loads(line)
            shape = tuple(_require_type(side, int) for side in request["shape"])
            count = _require_type(request["frames"], int)
            estimates = _require_type(request.get("homographies", False), bool)
            names = register_map.REQUESTED + (register_map.ESTIMATION if estimates else ())
            settings = {name: _require_type(request["settings"][name], int) for name in names}
            hold_reference = _require_type(request["hold_reference"], bool)
            rules = _require_type(request["rules_digest"], int)
        # RecursionError: JSON that is nested thousands of times.
        except (KeyError, TypeError, ValueError, RecursionError) as error:
            raise ValueError(f"the request is malformed: {error}") from None
        if estimates and not register_map.BUILT["built_homographies"]:
            raise ValueError("the board estimates no homographies; export again with --homography")
        return shape, count, settings, hold_reference, rules, estimates

    def _check(self, shape, count, settings, rules):
        built = register_map.BUILT["built_rules_digest"]
        if rules != built:
            raise ValueError(
                f"the board decides matches by the rules {built:08x}, the request is for {rules:08x}; "
                "export again with these --rules"
            )
        if not 1 <= count <= MAX_FRAMES:
            raise ValueError(f"{count} frames requested; the server takes 1 to {MAX_FRAMES} at a time")
        if len(shape) not in (2, 3) or shape[2:] not in ((), (3,)):
            raise ValueError(f"frames have shape {shape}; it must be (height, width) or (height, width, 3)")
        if (settings["width_px"], settings["height_px"]) != (shape[1], shape[0]):
            raise ValueError("width_px and height_px differ from the frames' shape")
        self.server.accelerator.check(settings)
        self.server.accelerator.check_frame(shape)

    def _frame(self, shape):
        data = self.client.bytes(self.frame_bytes)
        self.frames_left -= 1
        return data.reshape(shape)

    def _refuse(self, reason):
        try:
            # A client that is still sending would not read the answer.
            for _ in range(self.frames_left):
                self.client.bytes(self.frame_bytes)
            self.client.answer({"error": reason})
        except ClientGoneError:
            return


def _require_type(value, kind):
    # Not isinstance, for which True is an int.
    if type(value) is not kind:
        raise TypeError(f"{value!r:.40} is not of type {kind.__name__}")
    return value


class Server(socketserver.TCPServer):
    """Serves one client after the other, because there is only one accelerator.

    Parameters
    ----------
    address : (str, int)
        Host, of this machine's loopback, and port to listen on.
    accelerator : skymosaic_driver.Accelerator
    idle_seconds, request_seconds : float
        See `Client`.
    handler : type
        What serves a client.

    Raises
    ------
    ValueError
        Where others could reach the server, or if it cannot listen there.
    """

    # A restarted server need not wait until old connections have timed out.
    allow_reuse_address = True

    def __init__(
        self, address, accelerator, idle_seconds=IDLE_SECONDS, request_seconds=REQUEST_SECONDS, handler=Handler
    ):
        if not _is_loopback(address[0]):
            raise ValueError(f"others could use the board at {address[0]!r}; leave out --host and use an SSH tunnel")
        self.accelerator = accelerator
        self.idle_seconds, self.request_seconds = idle_seconds, request_seconds
        if ":" in address[0]:
            self.address_family = socket.AF_INET6
        try:
            super().__init__(address, handler)
        except (OSError, OverflowError) as error:
            raise ValueError(f"cannot listen on {address[0]}:{address[1]}: {error}; see --host and --port") from None


def options_parser(description, port=PORT):
    """Make the option parser of a program that serves an accelerator; programs add their own options."""
    parser = argparse.ArgumentParser(description=description, epilog=TUNNEL_HELP.format(port))
    parser.add_argument("--host", default="127.0.0.1", help="address of this machine's loopback to listen on")
    parser.add_argument("--port", type=int, default=port)
    return parser


def serve(parser, open_accelerator, handler=Handler):
    """Serve the accelerator that ``open_accelerator`` makes from the options, until the program is interrupted."""
    options = parser.parse_args()
    try:
        server = Server((options.host, options.port), open_accelerator(options), handler=handler)
    except (OSError, ValueError, AcceleratorError) as error:
        parser.error(str(error))
    with server:
        print(f"serving on {options.host}:{options.port}")
        with contextlib.suppress(KeyboardInterrupt):
            server.serve_forever()


def _is_loopback(host):
    try:
        return host == "localhost" or ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False
