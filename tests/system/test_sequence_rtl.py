"""Three frames back to back through the accelerator's Verilog, each matched with the one before or with the first."""

import cv2
import numpy as np
import pytest

from hdl.build import Build
from sim.backends.interface import Reference
from sim.scene import make_lawnmower
from sim.simulators import verilator
from sim.simulators.accelerator_designs import MATCHES, design_accelerator
from sim.simulators.hardware import decode_recordings, make_segments
from sim.simulators.scoreboard import Coverage, find_clock_mismatch, find_mismatch, predict_timelines
from skymosaic.features.backends import load_backend

FRAMES, SIZE_PX = 3, (400, 300)
FRAME_CYCLES = SIZE_PX[0] * SIZE_PX[1]
BUILD = Build()
CONFIG = BUILD.config
MIN_MATCHES = 250


@pytest.fixture(scope="module")
def flight() -> list[np.ndarray]:
    images = make_lawnmower(seed=6, images=FRAMES, size=SIZE_PX, forward_overlap=0.88, side_overlap=0.88).images
    return [cv2.cvtColor(image, cv2.COLOR_BGR2GRAY) for image in images]


@pytest.mark.parametrize("reference", ["previous", pytest.param("held", marks=pytest.mark.slow)])
def test_no_frame_waits_and_every_match_comes_in_time(flight: list[np.ndarray], reference: Reference) -> None:
    design = design_accelerator(BUILD)
    (recording,) = verilator.simulate(design, make_segments(flight, CONFIG, reference), progress=print)
    matches = recording.outputs[MATCHES]
    assert np.diff(recording.starts.astype(np.int64)).tolist() == [FRAME_CYCLES] * (FRAMES - 1)
    next_frame_ends = recording.starts + np.uint64(2 * FRAME_CYCLES)
    assert (matches.ends[:, 1] < next_frame_ends).all()

    results = decode_recordings([recording], CONFIG)
    assert [int(result.status["frame"]) for result in results] == list(range(FRAMES))
    golden = load_backend("golden").run(flight, CONFIG, reference=reference)
    mismatch = find_mismatch(golden, results)
    assert mismatch is None, str(mismatch)
    timelines = predict_timelines(golden, results, BUILD, reference)
    assert len(timelines) == FRAMES
    mismatch = find_clock_mismatch(timelines, results)
    assert mismatch is None, str(mismatch)
    late = [timeline.delay(number == FRAMES - 1) for number, timeline in enumerate(timelines)]
    assert find_clock_mismatch(late, results).frame == FRAMES - 1
    assert not Coverage.of(results).missing(CONFIG.front_end)
    assert min(len(result.matches) for result in results[1:]) > MIN_MATCHES
