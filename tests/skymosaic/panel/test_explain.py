"""Explanations agree with the match records: the panel shows what the matcher computed."""

import numpy as np
import pytest

from golden_model.config import preset_config
from golden_model.formats import WEIGHT
from sim.scene import make_pair
from skymosaic import register
from skymosaic.panel.explain import classify_matches, explain
from skymosaic.registration.pair import Pair

METHODS = {
    "aerial": {},
    "thesis": {"config": preset_config("thesis")},
    "correlation": {"descriptor": "window-10"},
    "ratio test": {"detector": "orb"},
}


@pytest.fixture(scope="module")
def images() -> list[np.ndarray]:
    return list(make_pair(seed=9, size=(240, 180)).images)


@pytest.fixture(scope="module", params=list(METHODS.values()), ids=list(METHODS))
def pair(request: pytest.FixtureRequest, images: list[np.ndarray]) -> Pair:
    left, right = images
    return register(left, right, **request.param)


def test_every_verdict_has_a_reason_that_agrees(pair: Pair) -> None:
    """Sugeno's weighted mean of the strengths and outputs shown equals the recorded weight, up to UQ0.8's rounding."""
    shown = classify_matches(pair)
    assert shown.count("inlier") == len(pair.inliers)
    assert shown.count("rejected") == len(pair.matches) - len(pair.kept)
    for index, verdict in enumerate(shown):
        explanation = explain(pair, index)
        assert explanation.verdict == verdict
        assert explanation.reason.startswith("Rejected." if verdict == "rejected" else "Kept.")
        if rules := explanation.rules:
            assert ("not above" in explanation.reason) == (verdict == "rejected")
            strength = sum(rule.strength for rule in rules)
            mean = sum(rule.strength * rule.output for rule in rules) / max(strength, 1e-9)
            assert abs(mean - pair.matches["weight"][index] / WEIGHT.one) <= 1.5 / WEIGHT.one
            (dominant,) = [rule for rule in rules if rule.dominant]
            assert dominant.strength == max(rule.strength for rule in rules)
            assert dominant.words in explanation.reason
