"""The camera build's bus, reader and scorer as they are exported, on PYNQ's own classes and the build's Verilog."""

import dataclasses
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from golden_model.config import PRESETS
from golden_model.geometry.scoring import answers, quantise
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
    """The simulated board, its bus, a reader of the rings and a scorer, on a version of PYNQ."""
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
        scorer, error = load("skymosaic_scores").Scorer(bus), load("skymosaic_registers").AcceleratorError
        yield SimpleNamespace(system=system, bus=bus, rings=rings, scorer=scorer, error=error)
        rings.close()
    assert bench.violations == 0
    bench.close()
    remove_pynq()


def check_scores(board: Any, matches: np.ndarray, frame: int) -> None:
    """Scores by the newest frame's matches equal the golden model."""
    homographies = np.eye(3) + np.random.default_rng(1).normal(size=(9, 3, 3)) * [[1e-3], [1e-3], [1e-6]]
    hypotheses = quantise(homographies)
    np.testing.assert_array_equal(board.scorer.score(homographies), answers(hypotheses, matches, frame))


def test_frames_and_scores_pass_pynqs_own_classes(board: Any) -> None:
    """Errors of the scores' DMA are named, and the next packet is scored."""
    frames, delivered = views(4), []
    board.system.bench.show(*frames)
    while (frame := board.rings.next_frame(0.2)) is not None:
        assert frame.good
        delivered.append((frame.number, frame.features.copy(), frame.matches.copy(), frame.homography))
        newest = int(frame.match_status["frame"])
        board.rings.release()
    assert delivered
    check(delivered, frames, board.rings.counts(), CONFIG)
    matches = delivered[-1][2]
    assert len(matches) > 20
    check_scores(board, matches, newest)
    ours, scorer = board.system.board, board.scorer
    for buffer, offset, name in ((scorer._sent, 200, "hypotheses"), (scorer._received, 40, "scores")):
        ours.bad_address = buffer.device_address + offset
        with pytest.raises(board.error, match=f"DMA of the {name} reports a slave error"):
            check_scores(board, matches, newest)
        ours.bad_address = None
        check_scores(board, matches, newest)
    with pytest.raises(board.error, match="DMA of the scores reports an internal error: a packet is longer"):
        board.bus.exchange(scorer._sent, 9 * 48, scorer._received[:32])
    check_scores(board, matches, newest)
