"""Texts, rules and rows of reports."""

import json
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree as XmlTree

import numpy as np
import pytest

from golden_model.fuzzy.sugeno import SugenoSystem
from sim.scene import make_pair
from skymosaic.features.positions import match_points
from skymosaic.geometry import estimators
from skymosaic.maps.features import Place, write_places
from skymosaic.registration.pair import Pair
from skymosaic.registration.register import register
from skymosaic.reports import figures, pages
from skymosaic.reports.pair import _table_rows, collect_pair_numbers, write_pair_report

NAME = "a\udcff\x1b[31m<b>&\x00.jpg"


def test_names_that_are_no_text_are_shown_and_written(tmp_path: Path) -> None:
    page = pages.render("pair.html", title=NAME, rows=[("name", f"{NAME}\nsecond")], pictures={})
    pages.write_report_files(tmp_path, {"name": NAME}, page)
    shown = (tmp_path / "index.html").read_text(encoding="utf-8")
    assert "\\udcff\\x1b[31m&lt;b&gt;&amp;\\x00.jpg" in shown
    assert json.loads((tmp_path / "report.json").read_bytes())["name"] == NAME
    write_places(tmp_path / "p.kml", NAME, [Place(NAME, "Polygon", np.zeros((5, 2)))])
    kml = XmlTree.fromstring((tmp_path / "p.kml").read_bytes())
    assert [each.text for each in kml.iter() if each.tag.endswith("name")] == ["a\\udcff\\x1b[31m<b>&\\x00.jpg"] * 2


def test_values_are_escaped_once_also_in_macros(tmp_path: Path) -> None:
    (tmp_path / "rows.html").write_text("{% macro row(name) %}<b>{{ name }}</b>{% endmacro %}{{ row(name) }}")
    assert pages.open_templates(tmp_path).get_template("rows.html").render(name="<i>") == "<b>&lt;i&gt;</b>"


LEFT, RIGHT = make_pair(seed=5, size=(320, 240)).images


def test_fuzzy_ransac_shows_what_its_six_rules_decide() -> None:
    pair = register(LEFT, RIGHT, detector="sift", descriptor="thesis-ilbp-4", estimator="fuzzy-ransac")
    decided, names = figures._find_deciding_rules(pair)
    _, decision = estimators.fuzzy(*match_points(pair.matches), pair.matches["verdict"] == 1)
    assert decision is not None
    np.testing.assert_array_equal(decided["verdict"], decision.inliers)
    assert not np.array_equal(decided["verdict"], pair.matches["verdict"])
    accepted = np.isin(
        decided["rule"], [names.index(f"bidirectional check verified, error {e}") for e in ("less", "equal")]
    )
    np.testing.assert_array_equal(decided["verdict"] == 1, accepted)


def test_where_no_rule_fires_the_accepting_rule_is_not_shown() -> None:
    pair = register(LEFT, RIGHT, preset="thesis")
    system = pair.method.rules(pair.config)
    assert isinstance(system, SugenoSystem)
    decided, names = figures._find_deciding_rules(pair)
    silent = decided["rule"] == len(names) - 1
    assert silent.any()
    np.testing.assert_array_equal(silent, (pair.matches["rule"] == 0) & (pair.matches["weight"] == 0))
    assert not decided["verdict"][silent].any()
    assert figures._rule_color(len(names) - 1, names) not in figures._RULE_COLORS


@pytest.fixture(scope="module")
def pair() -> Pair:
    """An accepted pair, of which only the right photograph has notes."""
    first, second = make_pair(seed=5, size=(320, 240)).images
    made = register(first, second, effort="fast")
    left = replace(made.left, name="/site/left.jpg", pixels=made.left.pixels[:200])
    right = replace(made.right, name="right.png", notes=("turned", "16 bits"))
    return replace(made, left=left, right=right, seconds={"features": 0.126, "matching": 1.0})


def test_the_rows_of_an_accepted_pair(pair: Pair) -> None:
    homography = np.array([[1.0, 0.25, -12.5], [0, 1, 3], [1e-5, 0, 1]])
    shown = replace(pair, homography=homography, refined_inliers=77, passes=3, known_evidence=pair.evidence)
    rows = dict(_table_rows(shown))
    left, right = map(len, pair.features)
    assert left != right
    assert rows == {
        "left": "left.jpg, 320x200 px",
        "right": "right.png, 320x240 px; turned; 16 bits",
        "verdict": "accepted",
        "confidence": f"good: {pair.confidence and pair.confidence.reason}",
        "corners": f"{left} and {right}",
        "matches": f"{len(pair.matches)}, {len(pair.kept)} kept by the rules, {len(pair.inliers)} on the homography",
        "refit": "to 77 points of dense flow",
        "homography, left to right, px": "1  0.25  -12.5\n0  1  3\n1e-05  0  1",
        "method": "harris + ilbp-128, prosac; passes: 3 (fast)",
        "computed by": "golden",
        "time": "features 0.13 s, matching 1.00 s",
    }


def test_a_refused_pair_says_why_and_has_no_row_of_what_it_lacks(pair: Pair, tmp_path: Path) -> None:
    refused = replace(pair, homography=None, reason="7 matches; `accept_poor` takes it", refined_inliers=0)
    rows = dict(_table_rows(refused))
    assert rows["verdict"] == "refused: 7 matches; --accept-poor takes it"
    assert list(rows) == ["left", "right", "verdict", "corners", "matches", "method", "computed by", "time"]
    write_pair_report(tmp_path, refused, None)
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "corners_left.png", "corners_right.png", "index.html", "matches.png", "report.json",
    ]  # fmt: skip


def test_the_numbers_of_a_pair_belong_to_its_sides(pair: Pair) -> None:
    half = replace(pair, working=(pair.working[0][:100, :160], pair.working[1]))
    numbers = collect_pair_numbers(half)
    assert numbers["left"] == {"name": "/site/left.jpg", "size": [320, 200], "working_size": [160, 100], "notes": []}
    assert numbers["right"]["notes"] == ["turned", "16 bits"]
    assert numbers["right"]["working_size"] == [320, 240]
    assert numbers["configuration"]["preset"] == "aerial"
    assert numbers["inliers"] == len(pair.inliers)
