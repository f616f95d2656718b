"""Explanations agree with the match records: the panel shows what the matcher computed."""

import numpy as np
import pytest

from golden_model.config import preset_config
from sim.scene import make_pair
from skymosaic import register
from skymosaic.panel.explain import HIGHEST_WEIGHT, explain, verdicts
from skymosaic.panel.pages import drawings
from skymosaic.panel.pages.explanation import markup
from skymosaic.panel.pair_view import PairView
from skymosaic.reports import pair as pair_report

METHODS = {
    "aerial": {},
    "thesis": {"config": preset_config("thesis")},
    "correlation": {"descriptor": "window-10"},
    "ratio test": {"detector": "orb"},
}


@pytest.fixture(scope="module")
def images() -> list[np.ndarray]:
    return list(make_pair(seed=9, size=(320, 240)).images)


@pytest.fixture(scope="module", params=METHODS.values(), ids=METHODS)
def view(request: pytest.FixtureRequest, images: list[np.ndarray]) -> PairView:
    pair = register(*images, **request.param)
    return PairView.of(pair, pair_report.pair_numbers(pair))


def test_strengths_and_outputs_give_the_recorded_weight(view: PairView) -> None:
    """Sugeno's weighted mean of the strengths and outputs shown equals the recorded weight, up to UQ0.8's rounding."""
    for index in range(len(view.matches)):
        rules = explain(view, index).rules
        if rules:
            strength = sum(rule.strength for rule in rules)
            mean = sum(rule.strength * rule.output for rule in rules) / max(strength, 1e-9)
            assert abs(mean - view.matches["weight"][index] / HIGHEST_WEIGHT) <= 1.5 / HIGHEST_WEIGHT


def test_the_dominant_rule_is_the_recorded_one(view: PairView) -> None:
    for index in range(len(view.matches)):
        explanation = explain(view, index)
        if explanation.rules:
            strongest = max(explanation.rules, key=lambda rule: rule.strength)
            (dominant,) = [rule for rule in explanation.rules if rule.dominant]
            assert dominant.strength == strongest.strength
            assert dominant.words in explanation.reason


def test_every_verdict_has_a_reason_that_agrees(view: PairView) -> None:
    shown = verdicts(view)
    assert shown.count("inlier") == view.inlier.sum()
    assert shown.count("rejected") == (~view.kept).sum()
    for index, verdict in enumerate(shown):
        explanation = explain(view, index)
        assert explanation.verdict == verdict
        assert explanation.reason.startswith("Rejected." if verdict == "rejected" else "Kept.")
        if explanation.rules:
            kept = "not above" not in explanation.reason
            assert kept == (verdict != "rejected")


def test_the_markup_shows_values_and_degrees(view: PairView) -> None:
    index = int(np.argmin(view.matches["verdict"]))
    explanation, page = explain(view, index), markup(explain(view, index))
    for item in explanation.inputs:
        assert f"{item.variable.name} {item.value}" in page
        for name, degree in item.degrees.items():
            assert f"{name} {degree:.2f}" in page
    assert page.count("<circle") == sum(len(item.degrees) for item in explanation.inputs)


def test_the_first_matches_are_spread_and_the_heaviest_of_their_cells() -> None:
    rng = np.random.default_rng(4)
    corner = np.hstack([rng.uniform(0, 50, (200, 2)), np.zeros((200, 2))])
    everywhere = np.hstack([rng.uniform(100, 800, (40, 2)), np.zeros((40, 2))])
    lines, weights = np.vstack([corner, everywhere]), rng.integers(0, 256, 240).astype(np.uint8)
    order = drawings.spread(lines, weights)
    assert sorted(order.tolist()) == list(range(240))
    # The crowd in one corner is represented by its heaviest match until every other cell has one, too.
    crowd = np.arange(240) < 200
    first = order[:15]
    assert crowd[first].sum() <= 1
    assert weights[order[crowd[order]][0]] == weights[crowd].max()
    assert len(drawings.spread(lines[:0], weights[:0])) == 0


def test_the_nearest_line_is_found_only_within_the_distance() -> None:
    lines = np.array([[0, 0, 100, 0], [0, 50, 100, 50], [200, 0, 200, 0]], dtype=np.float64)
    assert drawings.nearest(lines, 50, 10, within=12) == 0
    assert drawings.nearest(lines, 50, 41, within=12) == 1
    assert drawings.nearest(lines, 50, 25, within=12) is None
    assert drawings.nearest(lines, 110, 50, within=12) == 1
    assert drawings.nearest(lines, 203, 4, within=6) == 2
    assert drawings.nearest(lines[:0], 0, 0, within=1e9) is None
