"""The client of a board's server, which the export contains: the accelerator on the board as a backend."""

import json
import socket
from collections.abc import Sequence
from io import BufferedIOBase
from typing import Any

import numpy as np

from golden_model.arrays import Pixels, Records
from golden_model.config import Config
from golden_model.records import FRAME_STATUS, HOMOGRAPHY, MATCH, Cause, Tag
from golden_model.text import one_line
from hdl.settings import estimator_settings, matched_frame_settings
from sim.backends.errors import BackendError
from sim.backends.interface import Backend, FrameResult, Reference

PORT = 7020
TIMEOUT_SECONDS = 30.0
MAX_HEADER_BYTES = 1 << 16
MAX_REASON_CHARS = 500
PacketLimit = tuple[np.dtype[np.void], int]
"""The type of a packet's records, and how many it has at most."""


class BoardBackend(Backend):
    """Features, matches and homographies computed by a board.

    Parameters
    ----------
    address : str
        ``HOST`` or ``HOST:PORT`` of the server that the export contains.

    Raises
    ------
    BackendError
        For a missing or invalid address.
    """

    takes_one_size = True

    def __init__(self, address: str) -> None:
        host, _, port = address.partition(":")
        if not address:
            raise BackendError("the address of the board is missing; give it with --address HOST[:PORT]")
        if not host or (port and not (port.isdecimal() and int(port) < 1 << 16)):
            raise BackendError(f"{address!r} is not the address of a board; give HOST or HOST:PORT")
        self.address = host, int(port or PORT)
        self.where = one_line(f"{host}:{port or PORT}")

    def run(self, frames: Sequence[Pixels], config: Config, *, reference: Reference = "held") -> list[FrameResult]:
        """See `sim.backends.interface.Backend.run`; all frames must have one shape.

        Raises
        ------
        BackendError
            If the board cannot be reached, refuses the frames, or sends an answer that cannot be parsed.
        """
        shapes = {frame.shape for frame in frames}
        if len(shapes) != 1:
            raise BackendError("a board takes frames of one size and kind in a run; crop or convert the photographs")
        (shape,) = shapes
        request = {
            "shape": list(shape),
            "frames": len(frames),
            "settings": matched_frame_settings(config, shape[1], shape[0], gray_input=len(shape) == 2)
            | estimator_settings(config),
            "homographies": config.estimator is not None,
            "hold_reference": reference == "held",
            "rules_digest": config.matcher.rules_digest(config.front_end.pattern),
        }
        packets = _list_packets(config)
        parts = self._exchange(json.dumps(request).encode(), frames, packets * len(frames))
        try:
            results = [_join_records(*records) for records in zip(*[iter(parts)] * len(packets), strict=True)]
        except ValueError as error:
            raise BackendError(
                f"the board was built for other records: {error}; export the design again and rebuild it"
            ) from None
        for index, result in enumerate(results):
            _check_status(result, int(results[0].status["frame"]) + index, shape, self.where)
        return results

    def _exchange(self, header: bytes, frames: Sequence[Pixels], packets: Sequence[PacketLimit]) -> list[Records]:
        """Send a request and return the packets."""
        where = self.where
        try:
            with (
                socket.create_connection(self.address, TIMEOUT_SECONDS) as connection,
                connection.makefile("rwb") as link,
            ):
                link.write(header + b"\n")
                link.flush()
                # Wait for the server to accept the settings before sending frames: if it refuses them and closes the
                # connection while we are sending, its reason is lost.
                _read_header(link, where)
                for frame in frames:
                    link.write(np.ascontiguousarray(frame).data)
                link.flush()
                return _read_packets(link, where, packets)
        except OSError as error:
            raise BackendError(
                f"no board answers at {where} ({error.strerror or error}); start serve.py on it, or check the address"
            ) from None


def _read_header(link: BufferedIOBase, where: str) -> dict[str, Any]:
    """Read the server's next line, a JSON object; raise the error that it reports."""
    try:
        header: Any = json.loads(link.readline(MAX_HEADER_BYTES))
    except (ValueError, RecursionError):  # JSON that is nested thousands of times exhausts the stack
        header = None
    if not isinstance(header, dict):
        raise BackendError(f"the answer from {where} does not come from a board's server; check the address") from None
    if "error" in header:
        raise BackendError(f"the board at {where} reports: {one_line(str(header['error'])[:MAX_REASON_CHARS])}")
    return header


def _list_packets(config: Config) -> list[PacketLimit]:
    """A frame's packets: features, status, matches, status, homography."""
    most, status = config.front_end.max_features, (FRAME_STATUS.dtype, 1)
    packets = [(config.front_end.pattern.record.dtype, most), status, (MATCH.dtype, most), status]
    return [*packets, (HOMOGRAPHY.dtype, 1)] if config.estimator else packets


def _read_packets(link: BufferedIOBase, where: str, packets: Sequence[PacketLimit]) -> list[Records]:
    """Read the packets that the server announces."""
    lengths = _read_header(link, where).get("lengths")
    # Checked before anything is read, so that a false length cannot make us wait or fill the memory.
    if type(lengths) is not list or [*map(type, lengths)] != [int] * len(packets):
        raise BackendError(f"the board at {where} announces other packets than were asked for; check its server")
    sizes = [dtype.itemsize for dtype, _ in packets]
    if not all(0 <= length <= most * size for length, size, (_, most) in zip(lengths, sizes, packets, strict=True)):
        raise BackendError(f"the board at {where} announces packets of an invalid length; check its server")
    if any(length % size for length, size in zip(lengths, sizes, strict=True)):
        raise BackendError(
            f"the board at {where} was built for other records, whose lengths differ; export the design again and "
            "rebuild it"
        )
    parts = [link.read(length) for length in lengths]
    if [len(part) for part in parts] != lengths:
        raise BackendError(f"the board at {where} stopped in the middle of an answer; check its server")
    return [np.frombuffer(part, dtype) for part, (dtype, _) in zip(parts, packets, strict=True)]


def _join_records(
    features: Records, status: Records, matches: Records, match_status: Records, *homographies: Records
) -> FrameResult:
    (status_record,), (match_record,) = status, match_status
    (homography,) = homographies[0] if homographies else (None,)
    cycles = int(status_record["cycles"])
    return FrameResult(features, matches, status_record, match_record, cycles=cycles, homography=homography)


def _check_status(result: FrameResult, number: int, shape: tuple[int, ...], where: str) -> None:
    """Check that both statuses belong to the frame that was sent, and that it was taken in whole.

    A frame with too many features is bad too, but complete; the caller raises the threshold and sends it again.
    """
    found = result.homography
    if found is not None and (found["tag"] != Tag.HOMOGRAPHY or found["frame"] != result.status["frame"]):
        raise BackendError(f"the board at {where} sent another frame's homography; restart serve.py on it")
    for status in (result.status, result.match_status):
        if status["tag"] != Tag.FRAME_STATUS:
            fault = "an answer without a frame's status"
        elif int(status["frame"]) != number % (1 << 32):
            fault = f"frame {int(status['frame'])} instead of {number % (1 << 32)}"
        elif (status["height"], status["width"]) != shape[:2]:
            fault = f"a frame of {status['width']}x{status['height']}"
        elif int(status["causes"]) & ~Cause.TOO_MANY_FEATURES or bool(status["good"]) == bool(status["causes"]):
            fault = f"a bad frame (causes {int(status['causes']):#x})"
        else:
            continue
        raise BackendError(f"the board at {where} sent {fault}; restart serve.py on it")
