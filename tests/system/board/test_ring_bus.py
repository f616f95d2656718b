"""The camera build's bus and reader as they are exported, on PYNQ's own classes and the build's Verilog."""

import dataclasses
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import pytest

from golden_model.config import PRESETS
from hdl.settings import REQUESTED
from sim.benches.camera import CameraBench, CameraTiming
from sim.benches.exported import host_programs
from sim.benches.memory import MemoryRules
from tests.system import test_camera_build
from tests.system.board.pynq_board import ACCELERATOR_ADDRESS, CameraSystem
from tests.system.board.pynq_package import NEWEST, OLDER, import_pynq, remove_pynq
from tests.system.test_camera_build import SETTINGS, SLOTS, check, views

CONFIG = PRESETS["aerial"]
BUILD = dataclasses.replace(test_camera_build.BUILD, config=CONFIG)

pytestmark = [pytest.mark.slow, pytest.mark.needs("pynq")]


@pytest.fixture(scope="module", params=[NEWEST, *OLDER])
def board(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    """The simulated board and a reader of the rings, on a version of PYNQ."""
    camera = CameraTiming(line_blank=20, frame_blank=40_000, steps=3, period=4)
    rules = MemoryRules(waits=60, latency_clocks=60)
    bench = CameraBench(BUILD, length_bytes=1 << 22, camera=camera, rules=rules)
    system = CameraSystem(bench)
    import_pynq(request.param, system.board)
    with host_programs(BUILD) as load:
        overlay: Any = load("pynq_overlay")
        overlay.LOCK = tmp_path_factory.mktemp("lock") / "lock"
        bus = load("ring_bus").RingBus("skymosaic_camera.bit", ACCELERATOR_ADDRESS)
        settings = {name: SETTINGS[name] for name in (*REQUESTED, "gray_input")}
        rings = load("skymosaic_rings").RingReader(bus, settings, slots=SLOTS)
        yield SimpleNamespace(system=system, rings=rings)
        rings.close()
    assert bench.violations == 0
    bench.close()
    remove_pynq()


def test_frames_pass_pynqs_own_classes(board: Any) -> None:
    frames, delivered = views(4), []
    board.system.bench.show(*frames)
    while (frame := board.rings.next_frame(0.2)) is not None:
        assert frame.good
        delivered.append((frame.number, frame.features.copy(), frame.matches.copy(), frame.homography))
        board.rings.release()
    assert delivered
    check(delivered, frames, board.rings.counts(), CONFIG)
    assert len(delivered[-1][2]) > 20
