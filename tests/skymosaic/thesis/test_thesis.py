import csv
import dataclasses
import io
import itertools
from pathlib import Path

import cv2
import numpy as np
import pytest
from typer.testing import CliRunner

from skymosaic.cli import app
from skymosaic.errors import InputError
from skymosaic.evaluation.known_pairs import COLUMNS
from skymosaic.thesis import dataset, page, pictures, published, tables
from skymosaic.thesis.corners import CORNERS, compute_responses, detect_strongest, find_threshold, raise_threshold
from skymosaic.thesis.dataset import DatasetPair
from skymosaic.thesis.experiments import find_best_pair, run_experiments
from skymosaic.thesis.matches import measure_rings, measure_windows
from skymosaic.thesis.measurements import Measurement, Measurements

FIRST_PAIRS = 1


@pytest.fixture(scope="module")
def pair() -> DatasetPair:
    return dataset.list_sources(None)[0]()


@pytest.fixture(scope="module")
def measured() -> Measurements:
    return run_experiments(dataset.list_sources(None)[:FIRST_PAIRS])


def test_every_table_is_measured_on_every_pair(measured: Measurements) -> None:
    assert len(measured.pairs) == FIRST_PAIRS
    everywhere = {"IV-1", "adaptive", "IV-2", "IV-3", "IV-4", "IV-5", "stages", "figure IV-6"}
    for pair in measured.pairs:
        assert everywhere <= {line.table for line in measured.lines if line.pair == pair}
    assert measured.values("IV-7", "aerial preset", "whole")


def test_the_published_trends_hold_on_a_rendered_flight(measured: Measurements) -> None:
    # Seconds are left out: a busy machine decides them.
    found = {trend.statement: trend for trend in tables.check_trends(measured) if "time" not in trend.statement}
    assert len(found) == 6
    assert {statement for statement, trend in found.items() if not trend.holds} == set()


def test_published_recall_is_inliers_over_matched() -> None:
    ratios = [round(row[5] / row[2], 2) for row in published.FUZZY_RANSAC.values()]
    np.testing.assert_allclose(ratios, [*published.RECALL["scenes"], *published.RECALL["tests"]], atol=0.011)


def test_good_and_false_matches_are_the_stages_input(pair: DatasetPair) -> None:
    lines = [*measure_windows(pair), *measure_rings(pair)]
    counts = [values for table, _, values in lines if table != "stages"]
    stages = [values for table, _, values in lines if table == "stages"]
    for before, after in zip(counts, stages, strict=True):
        assert after["TP"] + after["FN"] == before["good"]
        assert after["TP"] + after["FP"] + after["TN"] + after["FN"] == before["matches"]


def test_the_strongest_corners_are_those_above_their_threshold(pair: DatasetPair) -> None:
    gray = pair.grays[0]
    threshold, features = find_threshold(gray), detect_strongest(gray)
    assert len(features) == np.count_nonzero(compute_responses(gray) >= threshold)
    assert CORNERS <= len(features) < CORNERS + 5


def test_the_threshold_doubles_until_the_matches_are_good(pair: DatasetPair) -> None:
    easy, hard = (raise_threshold(pair.grays, target) for target in (0.0, 1.0))
    assert len(easy) == 1
    assert all(later.threshold == 2 * earlier.threshold for earlier, later in itertools.pairwise(hard))
    assert all(one.quality < 1 for one in hard[:-1])
    corners = [len(one.features[0]) for one in hard]
    assert corners == sorted(corners, reverse=True)


def test_flat_images_have_no_threshold_to_raise_to() -> None:
    flat = np.full((160, 200), 90, np.uint8)
    assert len(raise_threshold((flat, flat))) == 1
    assert len(detect_strongest(flat)) == 0


def test_our_thresholds_are_scaled_to_the_published_corners(measured: Measurements) -> None:
    _, ours = tables.calibrate_corners(measured)
    highest = max(published.CORNERS)
    assert np.mean(ours[highest]) == pytest.approx(np.mean(published.CORNERS[highest]), rel=0.05)


def test_means_and_pooled_shares_by_hand() -> None:
    lines = [
        Measurement("T", "s", "a", "one", {"good": 1, "matches": 2}),
        Measurement("T", "s", "b", "two", {"good": 3, "matches": 10}),
        Measurement("T", "s", "c", "two", {"matches": 6}),
    ]
    found = Measurements(lines)
    assert found.mean("T", "s", "good") == 2
    assert found.mean("T", "s", "matches", "two") == 8
    assert found.ratio("T", "s", "good", "matches") == pytest.approx(4 / 18)
    assert np.isnan(found.mean("T", "s", "seconds"))
    assert np.isnan(found.ratio("T", "s", "good", "seconds"))
    assert found.groups == ["one", "two"]


def test_the_csv_holds_every_value(measured: Measurements) -> None:
    rows = list(csv.DictReader(io.StringIO(measured.to_csv())))
    assert len(rows) == sum(len(line.values) for line in measured.lines)
    assert set(rows[0]) == {"table", "setting", "pair", "group", "quantity", "value"}


@pytest.mark.slow
def test_the_page_has_every_table_and_stands_alone(measured: Measurements, pair: DatasetPair) -> None:
    shown = list(pictures.draw_pair(pair))
    text = page.compose_page(measured, "a <rendered> flight", shown, pair.name).decode()
    for number in range(1, 8):
        assert f"Table IV-{number}" in text
    assert "Figure IV-6" in text
    assert "a &lt;rendered&gt; flight" in text
    assert 'src="http' not in text
    assert text.count("data:image/svg+xml") == 7
    assert text.count("data:image/jpeg") == len(shown) == 7
    assert 0 <= find_best_pair(measured) < FIRST_PAIRS


def test_photographs_are_reduced_and_their_truth_with_them(tmp_path: Path, pair: DatasetPair) -> None:
    grow = np.array([[2, 0, 0.5], [0, 2, 0.5], [0, 0, 1]])
    for side, image in (("left", pair.left), ("right", pair.right)):
        cv2.imwrite(str(tmp_path / f"{side}.png"), np.repeat(np.repeat(image, 2, axis=0), 2, axis=1))
    truth = grow @ pair.truth @ np.linalg.inv(grow)
    values = ",".join(map(repr, (truth / truth[2, 2]).ravel().tolist()))
    (tmp_path / "pairs.csv").write_text(f"{','.join(COLUMNS)}\nbig,real,left.png,right.png,{values}\n")
    (source,) = dataset.list_sources(tmp_path)
    read = source()
    assert read.sizes == pair.sizes
    np.testing.assert_array_equal(read.left, pair.left)
    np.testing.assert_allclose(read.truth, pair.truth, atol=1e-9)


@pytest.mark.slow
def test_the_command_writes_page_and_measurements(tmp_path: Path, pair: DatasetPair) -> None:
    for side, image in (("left", pair.left), ("right", pair.right)):
        cv2.imwrite(str(tmp_path / f"{side}.png"), image)
    values = ",".join(map(repr, pair.truth.ravel().tolist()))
    (tmp_path / "pairs.csv").write_text(f"{','.join(COLUMNS)}\nonly,real,left.png,right.png,{values}\n")
    result = CliRunner().invoke(app, ["thesis", "--data", str(tmp_path), "-o", str(tmp_path / "out")])
    assert result.exit_code == 0, result.output
    assert {path.name for path in (tmp_path / "out").iterdir()} == {"index.html", "measurements.csv"}


def test_the_command_names_a_missing_list(tmp_path: Path) -> None:
    result = CliRunner().invoke(app, ["thesis", "--data", str(tmp_path), "-o", str(tmp_path / "out")])
    assert isinstance(result.exception, InputError)
    assert "pairs.csv" in str(result.exception)


def test_a_homography_without_overlap_is_named(pair: DatasetPair) -> None:
    away = np.array([[1.0, 0, 5000], [0, 1, 0], [0, 0, 1]])
    with pytest.raises(InputError, match="do not overlap"):
        dataclasses.replace(pair, truth=away)
