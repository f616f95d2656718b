"""Which rule a picture of matches shows, and which matches it shows as kept."""

import numpy as np

from golden_model.fuzzy.sugeno import SugenoSystem
from sim.scene import make_pair
from skymosaic.features.positions import match_points
from skymosaic.geometry import estimators
from skymosaic.registration.register import register
from skymosaic.reports import figures

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
