"""The board's server as it is exported, with a stand-in for the accelerator: no simulator is needed."""

import socket
import sys
import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import AbstractContextManager, contextmanager
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest

from golden_model.config import Config, FrontEndConfig
from golden_model.records import FRAME_STATUS, MATCH, Tag
from hdl.build import Build
from sim.benches.exported import host_programs

CONFIG = Config(front_end=FrontEndConfig(max_features=256))
PATTERN = CONFIG.front_end.pattern
FEATURE = PATTERN.record.dtype


class StandIn:
    """Answers each frame at once with three features and no matches."""

    max_width_px, max_height_px = 192, 160

    def __init__(self) -> None:
        self.frames = 0

    def check(self, settings: dict[str, int]) -> None:
        """The driver's own check, which needs the map only."""
        sys.modules["skymosaic_registers"].Registers.check(self, settings)

    def check_frame(self, shape: tuple[int, ...]) -> None:
        """Every frame fits a DMA's transfer."""

    def run(
        self, frames: Iterable[np.ndarray], settings: dict[str, int], hold_reference: bool
    ) -> list[SimpleNamespace]:
        return [self._result(frame) for frame in frames]

    def _result(self, frame: np.ndarray) -> SimpleNamespace:
        status = np.zeros((), FRAME_STATUS.dtype)
        status["tag"], status["good"], status["frame"] = Tag.FRAME_STATUS, 1, self.frames
        status["height"], status["width"], status["features"] = *frame.shape[:2], 3
        self.frames += 1
        features, matches = np.zeros(3, FEATURE), np.zeros(0, MATCH.dtype)
        return SimpleNamespace(features=features, matches=matches, status=status, match_status=status)


@pytest.fixture(scope="module")
def server_module() -> Iterator[ModuleType]:
    with host_programs(Build(config=CONFIG, max_width_px=192, max_height_px=160)) as load:
        load("skymosaic_registers")
        yield load("skymosaic_server")


Serve = Callable[..., AbstractContextManager[tuple[StandIn, str]]]


@pytest.fixture
def serve(server_module: ModuleType) -> Serve:
    """Context of a running server: its accelerator and its address."""

    @contextmanager
    def served(**options: object) -> Iterator[tuple[StandIn, str]]:
        device = StandIn()
        with server_module.Server(("127.0.0.1", 0), device, **options) as server:
            thread = threading.Thread(target=server.serve_forever, args=(0.05,))
            thread.start()
            yield device, f"127.0.0.1:{server.server_address[1]}"
            server.shutdown()
            thread.join()

    return served


@pytest.fixture
def answering() -> Callable[[bytes], AbstractContextManager[str]]:
    """Context of a peer that accepts one connection and sends fixed bytes, whatever it receives; its address."""

    @contextmanager
    def peer(answer: bytes) -> Iterator[str]:
        with socket.create_server(("127.0.0.1", 0)) as listening:

            def talk() -> None:
                connection, _ = listening.accept()
                with connection:
                    connection.recv(1 << 16)
                    connection.sendall(answer)
                    connection.shutdown(socket.SHUT_WR)
                    while connection.recv(1 << 16):
                        pass

            thread = threading.Thread(target=talk)
            thread.start()
            yield f"127.0.0.1:{listening.getsockname()[1]}"
            thread.join()

    return peer
