"""The accelerator on a board as a backend: a client of the server that the export contains."""

from __future__ import annotations

import json
import socket
from collections.abc import Sequence
from io import BufferedIOBase
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from golden_model.config import Config
from golden_model.records import FRAME_STATUS, MATCH, feature_record
from hdl.settings import matched_frame_settings
from sim.backend import Backend, BackendError, FrameResult, Reference

PORT = 7020
TIMEOUT_SECONDS = 30.0
LARGEST_HEADER_BYTES = 1 << 16
LARGEST_PACKET_BYTES = 1 << 22


class BoardBackend(Backend):
    """Features and matches computed by a board.

    Parameters
    ----------
    address : str
        ``HOST`` or ``HOST:PORT`` of the server that the export contains.
    """

    def __init__(self, address: str) -> None:
        host, _, port = address.partition(":")
        if not address:
            raise BackendError("the address of the board is missing; give it with --address HOST[:PORT]")
        if not host or (port and not port.isdigit()):
            raise BackendError(f"{address!r} is not the address of a board; give HOST or HOST:PORT")
        self.address = host, int(port or PORT)

    def run(
        self, frames: Sequence[NDArray[np.uint8]], config: Config, *, reference: Reference = "held"
    ) -> list[FrameResult]:
        """See `sim.backend.Backend.run`; all frames must have one shape.

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
            "settings": matched_frame_settings(config, shape[1], shape[0], gray_input=len(shape) == 2),
            "hold_reference": reference == "held",
        }
        parts = self._exchange(json.dumps(request).encode() + b"\n", frames)
        pattern = config.front_end.pattern
        feature = feature_record(pattern.descriptor_bytes, pattern.window_bytes).dtype
        try:
            return [_result(packet, feature) for packet in zip(*[iter(parts)] * 4, strict=True)]
        except ValueError as error:
            raise BackendError(
                f"the board was built for other records: {error}; export the design again and rebuild it"
            ) from None

    def _exchange(self, header: bytes, frames: Sequence[NDArray[np.uint8]]) -> list[bytes]:
        where = "{}:{}".format(*self.address)
        try:
            with (
                socket.create_connection(self.address, TIMEOUT_SECONDS) as connection,
                connection.makefile("rwb") as link,
            ):
                link.write(header)
                link.flush()
                # Wait for the server to accept the settings before sending frames: if it refuses them and closes the
                # connection while we are sending, its reason is lost.
                _header(link, where)
                for frame in frames:
                    link.write(np.ascontiguousarray(frame).data)
                link.flush()
                return _answer(link, where)
        except OSError as error:
            raise BackendError(
                f"no board answers at {where} ({error.strerror or error}); start serve.py on it, or check the address"
            ) from None


def _header(link: BufferedIOBase, where: str, *names: str) -> list[Any]:
    """Read the server's next line and return its fields ``names``."""
    try:
        header = json.loads(link.readline(LARGEST_HEADER_BYTES))
        if "error" in header:
            raise BackendError(f"the board at {where} reports: {header['error']}")
        return [header[name] for name in names]
    except (KeyError, TypeError, ValueError):
        raise BackendError(f"the answer from {where} does not come from a board's server; check the address") from None


def _answer(link: BufferedIOBase, where: str) -> list[bytes]:
    (lengths,) = _header(link, where, "lengths")
    if type(lengths) is not list or not all(
        type(length) is int and 0 <= length <= LARGEST_PACKET_BYTES for length in lengths
    ):
        raise BackendError(f"the board at {where} announces packets of an invalid length; check its server")
    parts = [link.read(length) for length in lengths]
    if [len(part) for part in parts] != lengths:
        raise BackendError(f"the board at {where} stopped in the middle of an answer; check its server")
    return parts


def _result(parts: tuple[bytes, ...], feature: np.dtype[np.void]) -> FrameResult:
    features, status, matches, match_status = parts
    (status_record,) = np.frombuffer(status, FRAME_STATUS.dtype)
    (match_record,) = np.frombuffer(match_status, FRAME_STATUS.dtype)
    return FrameResult(
        features=np.frombuffer(features, feature),
        matches=np.frombuffer(matches, MATCH.dtype),
        status=status_record,
        match_status=match_record,
        cycles=int(status_record["cycles"]),
    )


def load(address: str, *, waves: Path | None) -> BoardBackend:
    """Make this backend for `sim.backend.load_backend`.

    Raises
    ------
    BackendError
        For a missing or invalid address; if waves are requested.
    """
    if waves is not None:
        raise BackendError("a board cannot write waves; use verilator, cxxrtl or pysim")
    return BoardBackend(address)
