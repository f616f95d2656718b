# amaranth: UnusedElaboratable=no
"""The model of time adds up the latencies that the blocks state; whole frames are compared in tests/system."""

import dataclasses
from typing import Any

import numpy as np
import pytest

from golden_model import timing
from golden_model.config import Config, EstimatorConfig, FrontEndConfig, MatcherConfig
from golden_model.feature.ilbp import PATTERNS
from golden_model.geometry.estimator import CYCLES, MAX_CYCLES, MAX_MATCHES
from golden_model.matching import rule_bases
from golden_model.timing import FrameWork, Latencies, steady_pace, timelines
from hdl.fuzzy.sugeno import Sugeno
from hdl.lib.skid_buffer import SkidBuffer
from hdl.matching.correlation import SumOfAbsoluteDifferences
from hdl.matching.hamming import Distances
from hdl.matching.nearest_neighbours import NearestNeighbours
from hdl.matching.orientation_histogram import FIND_CYCLES, SQUARE_CYCLES
from tests.hdl.conftest import unused_blocks

LANES = 4
CONFIG = Config(front_end=FrontEndConfig(max_features=80))
__all__ = ["unused_blocks"]


@pytest.mark.usefixtures("unused_blocks")
@pytest.mark.parametrize("pattern", [PATTERNS[each] for each in ("ilbp-128", "ilbp-256-upright", "thesis-ilbp-4")])
def test_latencies_are_those_that_the_blocks_state(pattern: Any) -> None:
    config = Config(front_end=FrontEndConfig(descriptor=pattern.name, border_px=20))
    latencies = Latencies.compute(config, lanes=LANES)
    search = NearestNeighbours(bits=pattern.bits, lanes=LANES, max_features=80)
    assert timing.DISTANCE_CYCLES[pattern.bits] == Distances(bits=pattern.bits, lanes=LANES).latency_cycles
    assert (latencies.drain, latencies.shortest_pass) == (search.drain_cycles, search.shortest_pass_cycles)
    for system in (
        rule_bases.aerial(pattern.bits),
        rule_bases.aerial_orientation(pattern.bits),
        rule_bases.ilbp(pattern.bits),
    ):
        assert timing.sugeno_cycles(system) == Sugeno(system=system, value_bits=12).latency_cycles
    if pattern.carries_window:
        assert SumOfAbsoluteDifferences(pixels=pattern.window_bytes).latency_cycles == timing.SAD_CYCLES
    assert latencies.skid_buffer == SkidBuffer.latency_cycles
    if pattern.oriented:
        assert latencies.peak == 2 * 16 + FIND_CYCLES
        assert latencies.count == timing.sugeno_cycles(rule_bases.aerial_orientation(pattern.bits)) + SQUARE_CYCLES + 2


@pytest.mark.parametrize(
    ("changes", "clocks"),
    [
        ({}, [308010, 308185, 308491, 308496]),
        ({"rows": np.arange(0)}, [308010, 308065, 308158, 308164]),
        ({"good": False, "rows": np.arange(0)}, [307214, 307214, 307214, 307220]),
        ({"left": 0, "rows": np.arange(0)}, [307216, 307217, 307256, 307262]),
        ({"right": 0, "rows": np.arange(0)}, [307216, 307217, 307256, 307262]),
    ],
)
def test_the_clocks_of_a_frame_are_the_recorded_ones(changes: dict[str, Any], clocks: list[int]) -> None:
    """What hardware takes for such frames: found until searched, counted, weighed, and the end of its packet."""
    frame = FrameWork(640, 480, good=True, left=50, right=60, rows=3 * np.arange(9))
    for estimate_cycles, homography in ((None, []), (2000, [clocks[-1] + 2000 + 9])):
        work = dataclasses.replace(frame, **changes, estimate_cycles=estimate_cycles)
        (line,) = timelines([work], CONFIG, lanes=4)
        assert [clock for _, clock in line.steps()] == [0, 307199, 307212, 307214, *clocks, *homography]


@pytest.mark.parametrize(("rule_base", "clocks"), [("aerial", 29), ("ilbp", 35), ("none", 8)])
def test_each_rule_base_has_its_clocks_for_a_match(rule_base: str, clocks: int) -> None:
    config = Config(front_end=FrontEndConfig(descriptor="thesis-ilbp-4"), matcher=MatcherConfig(rule_base=rule_base))
    assert Latencies.compute(config, lanes=LANES).weigh == clocks


@pytest.mark.parametrize(("row", "later_cycles"), [(49, 1), (40, 1), (39, 0), (0, 0)])
def test_the_status_waits_for_a_lone_match_unless_further_rows_follow(row: int, later_cycles: int) -> None:
    """As simulated: a clock for the estimator, whose first record nothing hides without rules."""
    config = Config(matcher=MatcherConfig(rule_base="none"))
    work = FrameWork(640, 480, good=True, left=50, right=60, rows=np.array([row]), estimate_cycles=2000)
    (alone,) = timelines([work], config, lanes=4)
    (estimated,) = timelines([work], dataclasses.replace(config, estimator=EstimatorConfig()), lanes=4)
    assert estimated.matches_end - alone.matches_end == later_cycles


def test_two_pixels_a_clock_take_half_the_clocks() -> None:
    """Odd lines take a clock more; what follows the last pixel takes as long as before."""
    frames = [FrameWork(641, 480, good=True, left=50, right=60, rows=np.arange(9)) for _ in range(2)]
    one, two = (timelines(frames, CONFIG, lanes=16, pixels_per_clock=each) for each in (1, 2))
    assert [line.status_cycles for line in (*one, *two)] == [641 * 480] * 2 + [321 * 480] * 2
    for slow, fast in zip(one, two, strict=True):
        assert slow.matches_end - slow.last_pixel == fast.matches_end - fast.last_pixel


def test_the_homography_before_sets_the_pace_of_small_frames_only() -> None:
    most = MAX_MATCHES
    frame = FrameWork(1280, 720, True, most, most, np.arange(most), estimate_cycles=MAX_CYCLES)
    accepted = [line.accepted for line in timelines([frame] * 4, Config(), lanes=16)]
    assert np.diff(accepted).tolist() == [1280 * 720] * 3
    frame = FrameWork(640, 480, good=True, left=most, right=most, rows=np.arange(most))
    longest = dataclasses.replace(frame, estimate_cycles=MAX_CYCLES)
    paces = [steady_pace(each, Config(), lanes=16) or (0, 0) for each in (frame, longest)]
    assert np.diff(paces, axis=0).tolist() == [[MAX_CYCLES + CYCLES.records, 0]]


def test_what_is_not_predicted_is_left_out() -> None:
    frame = FrameWork(640, 480, good=True, left=2000, right=2000, rows=np.arange(2000))
    # With four lanes a frame is not matched before the one after the next has features.
    assert len(timelines([frame] * 5, CONFIG, lanes=4)) == 2
    thesis = Config(front_end=FrontEndConfig(selection=False, levels=1))
    assert timelines([frame], thesis, lanes=4) == []
    # Full cells of the last rows would not have left in time.
    narrow = FrameWork(64, 106, good=True, left=0, right=0, rows=np.arange(0))
    for size_px, leaves in (((64, 106), False), ((64, 100), False), ((128, 100), False), ((160, 100), True)):
        frame = dataclasses.replace(narrow, width_px=size_px[0], height_px=size_px[1])
        assert bool(timelines([frame], CONFIG, lanes=4)) == leaves
