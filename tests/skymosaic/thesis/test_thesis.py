"""Corners, data, measurements and published numbers of the thesis."""

import csv
import dataclasses
import io
import itertools
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure

from bench.rendered_pairs import write_set
from skymosaic.common.errors import InputError
from skymosaic.thesis import charts, tables
from skymosaic.thesis.corners import CORNERS, compute_responses, detect_strongest, find_threshold, raise_threshold
from skymosaic.thesis.dataset import DatasetPair, list_sources
from skymosaic.thesis.measurements import Measurements
from skymosaic.thesis.published import PUBLISHED


def test_the_strongest_corners_are_those_above_their_threshold(pair: DatasetPair) -> None:
    gray = pair.grays[0]
    threshold, features = find_threshold(gray), detect_strongest(gray)
    assert len(features) == np.count_nonzero(compute_responses(gray) >= threshold)
    assert CORNERS <= len(features) < CORNERS + 5


def test_the_threshold_doubles_until_the_matches_are_good(pair: DatasetPair) -> None:
    easy, hard = (raise_threshold(pair.grays, target) for target in (0.0, 1.0))
    assert (len(easy), easy[0].threshold) == (1, 1 << 15)
    # The last has at least fifty corners in both, and the next one would not.
    assert len(hard) > 2
    assert min(map(len, hard[-1].features)) >= 50
    assert min(np.count_nonzero(compute_responses(gray) >= 2 * hard[-1].threshold) for gray in pair.grays) < 50
    assert all(later.threshold == 2 * earlier.threshold for earlier, later in itertools.pairwise(hard))
    assert all(one.quality < 1 for one in hard[:-1])
    corners = [len(one.features[0]) for one in hard]
    assert corners == sorted(corners, reverse=True)


def test_photographs_are_reduced_and_their_truth_with_them(tmp_path: Path, pair: DatasetPair) -> None:
    grow = np.array([[2, 0, 0.5], [0, 2, 0.5], [0, 0, 1]])
    left, right = (np.repeat(np.repeat(image, 2, axis=0), 2, axis=1) for image in (pair.left, pair.right))
    write_set(tmp_path, [("big", "real", left, right, grow @ pair.truth @ np.linalg.inv(grow))])
    (source,) = list_sources(tmp_path)
    read = source()
    assert read.sizes == pair.sizes
    np.testing.assert_array_equal(read.left, pair.left)
    np.testing.assert_allclose(read.truth, pair.truth, atol=1e-9)


def test_a_homography_without_overlap_is_named(pair: DatasetPair) -> None:
    away = np.array([[1.0, 0, 5000], [0, 1, 0], [0, 0, 1]])
    with pytest.raises(InputError, match="do not overlap"):
        dataclasses.replace(pair, truth=away)


def test_the_csv_holds_every_value(measured: Measurements) -> None:
    rows = list(csv.DictReader(io.StringIO(measured.to_csv())))
    assert len(rows) == sum(len(line.values) for line in measured.lines)
    assert set(rows[0]) == {"table", "setting", "pair", "group", "quantity", "value"}


def test_published_recall_is_inliers_over_matched() -> None:
    ratios = [round(PUBLISHED.number("IV-4", s, "inliers / matched"), 2) for s in PUBLISHED.settings("IV-4")]
    recall = [each for setting in ("scenes", "tests") for each in PUBLISHED.values("IV-6", setting, "recall")]
    assert ratios == pytest.approx(recall, abs=0.011)


def test_the_published_trends_hold_on_a_rendered_flight(measured: Measurements) -> None:
    # Seconds are left out: a busy machine decides them.
    trends = tables.check_trends(tables.scale_thresholds(measured))
    found = {trend.statement: trend for trend in trends if "time" not in trend.statement}
    assert len(found) == 7
    # Our corners are not limited in number; the thesis does not say what limits its own.
    assert {statement for statement, trend in found.items() if not trend.holds} == {
        "the number of corners levels off, at 734 (IV-1)"
    }


def test_our_thresholds_are_scaled_to_the_published_corners(measured: Measurements) -> None:
    scaled = tables.scale_thresholds(measured)
    assert scaled.settings("IV-1") == PUBLISHED.settings("IV-1")
    assert scaled.number("IV-1", "5000", "both") == pytest.approx(PUBLISHED.number("IV-1", "5000", "both"), rel=0.05)


RECORDED = Path(__file__).with_name("recorded_page.txt")
"""After a change that is meant, `write_out` of `made_up` writes it again."""


@pytest.fixture
def made_up(measured: Measurements) -> Measurements:
    """The lines of all experiments on two pairs, with falling numbers; of one setting, none."""
    lines = []
    for number, line in enumerate(measured.lines):
        for pair, group in enumerate(("along", "across")):
            top = 1200 - 20 * (number % 55) - 100 * pair
            found = {each: top / (1 + n) + n * number for n, each in enumerate(line.values)}
            values = {} if line.setting == "SIFT + SIFT" else found
            lines.append(replace(line, pair=f"pair {pair}", group=group, values=values))
    return Measurements(lines)


def write_out(m: Measurements) -> Iterator[str]:
    m = tables.scale_thresholds(m)
    for name, sheet in ((name, tables.tabulate(m, name)) for name in tables.TABLES):
        yield from (f"table {name}: {' | '.join(row)}" for row in (sheet[0], *(row.values() for row in sheet)))
    yield from (f"groups: {' | '.join(row.values())}" for row in tables.tabulate_groups(m, "IV-2", "px"))
    yield from (f"trend: {trend.statement} | {trend.holds} | {trend.numbers}" for trend in tables.check_trends(m))
    drawn: list[Figure] = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Figure, "savefig", lambda figure, *_, **__: drawn.append(figure))
        for draw in charts.CHARTS.values():
            draw(m)
    for name, figure in zip(charts.CHARTS, drawn, strict=True):
        every: list[Any] = figure.axes
        for legend in [*figure.legends, *filter(None, (axes.get_legend() for axes in every))]:
            yield f"diagram {name}: legend: {' | '.join(each.get_text() for each in legend.get_texts())}"
        for axes in every:
            words = axes.get_xlabel(), axes.get_xscale(), axes.get_ylabel(), axes.get_yscale()
            yield f"diagram {name}: {' '.join(words)} {' '.join(f'{each:.4g}' for each in axes.get_ylim())}"
            series: dict[str, Any] = {line.get_label(): line.get_xydata() for line in axes.lines}
            series |= {"bars": [(bar.get_x(), bar.get_height()) for bar in axes.patches]}
            series |= {"segments": [end for each in axes.collections for ends in each.get_segments() for end in ends]}
            for label, points in series.items():
                if len(points):
                    yield f"diagram {name}: {label}: {' '.join(f'{x:.3g},{y:.4g}' for x, y in points)}"
            if axes.texts:
                yield f"diagram {name}: {' '.join(text.get_text() for text in axes.texts)}"


def test_tables_and_diagrams_say_what_was_measured_and_published(made_up: Measurements) -> None:
    assert list(write_out(made_up)) == RECORDED.read_text(encoding="utf-8").splitlines()
