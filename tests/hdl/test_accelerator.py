"""The accelerator with an estimator: pixels in, a homography per frame out, equal to the golden model."""

import contextlib
import dataclasses
from pathlib import Path

import numpy as np
import pytest

from golden_model.config import PRESETS, EstimatorConfig
from hdl.build import Build
from hdl.registers.register_map import register_writes
from hdl.registers.shell_register_map import ALL_REGISTERS
from sim.backends.golden import GoldenBackend
from sim.backends.interface import FrameResult
from sim.scene import make_pair
from sim.simulators.accelerator_designs import HOMOGRAPHIES, design_accelerator
from sim.simulators.compiled import Bench
from sim.simulators.hardware import decode_recordings, make_segments
from sim.simulators.recording import NO_PAUSES, Pauses
from sim.simulators.scoreboard import find_clock_mismatch, find_mismatch, predict_timelines
from sim.simulators.verilator import build_library

WIDTH_PX, HEIGHT_PX = 192, 96
AERIAL = PRESETS["aerial"]
CONFIG = dataclasses.replace(
    AERIAL,
    front_end=dataclasses.replace(AERIAL.front_end, max_features=128, levels=1),
    estimator=EstimatorConfig(passes=4, seed=5, min_inliers=10),
)
BUILD = Build(config=CONFIG, lanes=4, max_width_px=WIDTH_PX, max_height_px=HEIGHT_PX)
DESIGN = design_accelerator(BUILD)


@pytest.fixture(scope="module")
def library() -> Path:
    return build_library(DESIGN)


def views(count: int) -> list[np.ndarray]:
    """Views of a scene that move."""
    scene = np.ascontiguousarray(make_pair(seed=9, size=(240, 140)).images[0][..., 1])
    return [scene[n : n + HEIGHT_PX, 3 * n : 3 * n + WIDTH_PX].copy() for n in range(count)]


def simulate(library: Path, frames: list[np.ndarray], pauses: Pauses) -> tuple[list[FrameResult], list[FrameResult]]:
    """The golden model's results of frames that follow each other, and the simulation's."""
    with contextlib.closing(Bench(library, DESIGN.ports)) as bench:
        recordings = [bench.run(segment, pauses) for segment in make_segments(frames, CONFIG, "previous")]
    return GoldenBackend().run(frames, CONFIG, reference="previous"), decode_recordings(recordings, CONFIG)


def test_a_frame_without_an_accepted_homography_does_not_become_the_reference(library: Path) -> None:
    """But a dark first one does not stay it. Frames come faster than they are estimated, and nothing is lost."""
    noise = np.random.default_rng(3).integers(0, 256, (2, HEIGHT_PX, WIDTH_PX), np.uint8)
    dark, frames = np.zeros_like(noise[0]), views(7)
    frames[2], frames[4], frames[5] = *noise, dark
    frames.insert(0, dark)
    golden, simulated = simulate(library, frames, Pauses(gaps=60, stalls=90, seed=3))
    assert find_mismatch(golden, simulated) is None
    homographies = np.array([each.homography for each in simulated])
    assert (homographies["causes"] == 0).tolist() == [False, False, True, False, True, False, False, True]
    # Without matches there is nothing that could name the reference.
    assert homographies["reference"].tolist() == [0, 0, 1, 2, 2, 4, 0, 4]
    assert set(simulated[7].matches["reference"]) == {4}


def test_its_clocks_are_predicted_up_to_the_first_frame_that_waits_long(library: Path) -> None:
    golden, simulated = simulate(library, views(4), NO_PAUSES)
    assert find_mismatch(golden, simulated) is None
    timelines = predict_timelines(golden, simulated, BUILD, "previous")
    assert find_clock_mismatch(timelines, simulated) is None
    # The third frame is accepted when the second one's homography is known, which delays the features of the fourth.
    assert len(timelines) == 3
    second, third = timelines[1:]
    assert second.homography_end
    assert third.features_end < second.homography_end < third.accepted + 20


def test_a_clear_forgets_what_is_being_estimated(library: Path) -> None:
    first, second = views(4)[:2], views(4)[2:]
    with contextlib.closing(Bench(library, DESIGN.ports)) as bench:
        (segment,) = make_segments(first, CONFIG, "previous")
        _, recording = bench.stream(dataclasses.replace(segment, cycle_limit=45_000), NO_PAUSES)
        assert [len(output.packets) for output in recording.outputs.values()] == [2, 2, 1]
        for address, value in register_writes({"clear": 1}, registers=ALL_REGISTERS):
            bench.write(address, value)
        recordings = [bench.run(segment) for segment in make_segments(second, CONFIG, "previous")]
    golden = GoldenBackend().run(second, CONFIG, reference="previous")
    assert find_mismatch(golden, decode_recordings(recordings, CONFIG)) is None


def test_an_output_that_is_off_discards_its_records(library: Path) -> None:
    with contextlib.closing(Bench(library, DESIGN.ports)) as bench:
        (segment,) = make_segments(views(2), CONFIG, "previous")
        ((address, _),) = register_writes({"homographies_enable": 0}, registers=ALL_REGISTERS)
        writes = [write for write in segment.writes if write[0] != address]
        is_done, recording = bench.stream(dataclasses.replace(segment, writes=writes, cycle_limit=400_000), NO_PAUSES)
    assert not is_done
    assert recording.outputs[HOMOGRAPHIES].words.size == 0
    assert [len(output.packets) for output in recording.outputs.values()] == [2, 2, 0]
