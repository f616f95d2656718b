"""The scoreboard: it finds what differs, says where, and does not take little evidence for much."""

import dataclasses
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

import hdl
from golden_model.arrays import Pixels
from golden_model.config import PRESETS
from golden_model.front_end import trace
from golden_model.pixel.harris import TENSOR_SHIFT
from golden_model.records import HOMOGRAPHY
from hdl.build import Build
from sim.backends.golden import GoldenBackend
from sim.backends.interface import FrameClocks, FrameResult, Mismatch
from sim.scene import make_pair
from sim.simulators.scoreboard import (
    BLOCKS,
    Coverage,
    find_clock_mismatch,
    find_mismatch,
    find_stage_mismatch,
    predict_timelines,
)
from sim.simulators.stages import locate_mismatch

AERIAL = PRESETS["aerial"]


@pytest.fixture(scope="module")
def frames() -> Sequence[Pixels]:
    return make_pair(seed=1).images


@pytest.fixture(scope="module")
def results(frames: Sequence[Pixels]) -> list[FrameResult]:
    return GoldenBackend().run(frames, AERIAL)


def changed(
    results: list[FrameResult], frame: int, part: str, field: str, *, row: int | None, value: int | Pixels
) -> list[FrameResult]:
    """The results with one value of one record changed."""
    records = getattr(results[frame], part).copy()
    if row is None:
        records[field] = value
    else:
        records[field][row] = value
    copies = list(results)
    copies[frame] = dataclasses.replace(results[frame], **{part: records})
    return copies


def expect_mismatch(expected: list[FrameResult], actual: list[FrameResult]) -> Mismatch:
    """What the scoreboard finds; it has to find something."""
    found = find_mismatch(expected, actual)
    assert found
    return found


def test_the_first_feature_that_differs_is_named_with_its_position(results: list[FrameResult]) -> None:
    assert find_mismatch(results, results) is None
    feature = results[1].features[77]
    found = expect_mismatch(
        results, changed(results, 1, "features", "sector", row=77, value=(feature["sector"] + 1) % 16)
    )
    assert (found.frame, found.stage) == (1, "feature 77, sector")
    assert (found.x, found.y) == (feature["x"] / 16, feature["y"] / 16)
    assert (found.expected, found.actual) == (feature["sector"], (feature["sector"] + 1) % 16)
    once = changed(results, 0, "features", "response", row=9, value=0)
    twice = changed(once, 0, "features", "index", row=4, value=4000)
    assert expect_mismatch(results, twice).stage == "feature 4, index"


@pytest.mark.parametrize("step", ["first_pixel", "features_end", "matches_end"])
def test_a_clock_that_differs_from_its_prediction_is_named(results: list[FrameResult], step: str) -> None:
    started = [dataclasses.replace(result, clocks=FrameClocks(0, 100, 0, 0)) for result in results]
    timelines = predict_timelines(results, started, Build(config=AERIAL), "held")
    found = []
    for result, timeline in zip(results, timelines, strict=True):
        status = result.status.copy()
        status["cycles"] = 640 * 480
        clocks = FrameClocks(0, timeline.first_pixel, timeline.features_end, timeline.matches_end)
        found.append(dataclasses.replace(result, status=status, clocks=clocks))
    assert find_clock_mismatch(timelines, found) is None
    assert timelines[0].first_pixel == 100
    assert found[1].clocks
    late = dataclasses.replace(found[1].clocks, **{step: getattr(found[1].clocks, step) + 1})
    mismatch = find_clock_mismatch(timelines, [found[0], dataclasses.replace(found[1], clocks=late)])
    assert mismatch
    assert (mismatch.frame, mismatch.stage) == (1, f"clock of {step.replace('_', ' ')}")
    assert mismatch.actual - mismatch.expected == 1


@pytest.mark.parametrize("field", ["h02", "causes", "cycles"])
def test_every_field_of_a_homography_counts(results: list[FrameResult], field: str) -> None:
    """Its clocks, too: the golden model knows them."""
    record = np.zeros(1, HOMOGRAPHY.dtype)[0]
    estimated = [dataclasses.replace(result, homography=record) for result in results]
    assert find_mismatch(estimated, estimated) is None
    found = expect_mismatch(estimated, changed(estimated, 1, "homography", field, row=None, value=7))
    assert str(found) == f"frame 1, homography, {field}: expected 0, got 7"
    assert expect_mismatch(estimated, [estimated[0], results[1]]).stage == "homography"


def test_a_missing_feature_is_a_mismatch(results: list[FrameResult]) -> None:
    short = [dataclasses.replace(results[0], features=results[0].features[:-1]), results[1]]
    missing = results[0].features[-1]
    assert str(expect_mismatch(results, short)) == (
        f"frame 0, feature count, x {missing['x'] / 16:g}, y {missing['y'] / 16:g}: "
        f"expected {len(results[0].features)}, got {len(results[0].features) - 1}"
    )


@pytest.mark.parametrize(
    ("part", "field", "row", "stage"),
    [
        ("features", "descriptor", 3, "feature 3, descriptor"),
        ("matches", "weight", 5, "match 5, weight"),
        ("status", "causes", None, "feature status, causes"),
        ("match_status", "kept", None, "match status, kept"),
    ],
)
def test_descriptors_matches_and_status_count(
    results: list[FrameResult], part: str, field: str, row: int | None, stage: str
) -> None:
    value = results[1].features["descriptor"][3] ^ [*[0] * 15, 128] if field == "descriptor" else 1
    assert expect_mismatch(results, changed(results, 1, part, field, row=row, value=value)).stage == stage


def test_cycles_do_not_count_and_a_pair_covers_enough_where_its_parts_do_not(results: list[FrameResult]) -> None:
    assert find_mismatch(results, changed(results, 0, "status", "cycles", row=None, value=1234)) is None
    config = AERIAL.front_end
    assert Coverage.of(results).missing(config) == []
    assert Coverage.of(results[:1]).missing(config) == ["0 matches, at least 100 needed"]
    one_level = [dataclasses.replace(r, features=r.features[r.features["level"] == 0]) for r in results]
    assert Coverage.of(one_level).missing(config) == ["0 level-1 features, at least 100 needed"]
    assert Coverage.of(one_level).missing(dataclasses.replace(config, levels=1)) == []


@pytest.mark.parametrize(
    ("features", "sectors", "matches", "missing"),
    [
        ((1000, 100), 16, 100, []),
        ((999, 100), 16, 100, ["999 level-0 features, at least 1000 needed"]),
        ((1000, 99), 16, 100, ["99 level-1 features, at least 100 needed"]),
        ((1000, 100), 15, 100, ["15 sectors, at least 16 needed"]),
        ((1000, 100), 16, 99, ["99 matches, at least 100 needed"]),
    ],
)
def test_enough_is_covered_at_the_limits(
    features: tuple[int, int], sectors: int, matches: int, missing: list[str]
) -> None:
    covered = Coverage(2, features, sectors, matches, homographies=sectors - 15)
    assert covered.missing(AERIAL.front_end) == missing
    words = (
        f"2 frames, {features[0]} + {features[1]} features of levels 0 + 1, {sectors} of 16 sectors, {matches} matches"
    )
    assert str(covered) == words + (", 1 homographies" if sectors == 16 else "")


def test_the_first_stage_that_differs_is_named(frames: Sequence[Pixels]) -> None:
    golden = trace(frames[0], AERIAL.front_end)
    planes = [
        {name: np.ma.masked_array(plane.values.astype(np.int64)) for name, plane in level.items()}
        for level in golden.levels
    ]
    assert find_stage_mismatch(golden, planes) is None
    planes[1]["tensor_b"][100, 50] += 1
    planes[1]["response_code"][20, 20] += 1
    planes[0]["gradient_x"][0, 0] += 1  # inside the margin, where nothing is specified
    planes[0]["gray"][3, 3] = np.ma.masked
    found = find_stage_mismatch(golden, planes, frame=4)
    assert found
    assert (found.frame, found.stage, found.x, found.y) == (4, "level 1 tensor_b (hdl/pixel/harris.py)", 50, 100)
    assert found.actual == found.expected + 1


def test_each_stage_has_the_file_of_a_block() -> None:
    assert set(BLOCKS) == {
        name.partition("_")[0] for name in trace(np.zeros((64, 64), np.uint8), AERIAL.front_end).levels[0]
    }
    files = {path.stem for path in (Path(hdl.__file__).parent / "pixel").iterdir()}
    assert {block for blocks in BLOCKS.values() for block in blocks.strip("{}").split(",")} <= files


@pytest.mark.slow
@pytest.mark.parametrize(("shift", "stage"), [(7, "level 0 tensor_a (hdl/pixel/harris.py)"), (TENSOR_SHIFT, None)])
def test_a_fault_in_the_hardware_is_located(
    frames: Sequence[Pixels], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, shift: int, stage: str | None
) -> None:
    """In a cache of its own, which finds builds by their code and not by what is patched."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    config = dataclasses.replace(AERIAL.front_end, levels=1)
    crop = np.ascontiguousarray(frames[0][100:164, 100:164])
    monkeypatch.setattr("hdl.pixel.harris.TENSOR_SHIFT", shift)
    found = locate_mismatch(crop, config)
    assert (found.stage if found else None) == stage
