import math

import numpy as np
import pytest

from bench.rendered_pairs import flat_pair
from skymosaic import register
from skymosaic.evaluation.metrics import grid_error
from skymosaic.registration.front_end_runs import QUARTERS, TILTED, choose_run_between_octaves
from skymosaic.registration.passes import MAX_PROMISING

SIZE = (321, 241)


@pytest.mark.parametrize("tilt", [(0, 0), (2e-3, -1e-3)])
@pytest.mark.parametrize(
    ("zoom", "reduction"),
    [
        (0.9, None), (2**0.18, None), (2**0.2, math.sqrt(8)), (2**1.18, None), (2**1.2, math.sqrt(8)),
        (1.1, None), (2.1, None), (1.2, 2), (math.sqrt(2), 2), (3, 2), (4, math.sqrt(8)),
    ],
)  # fmt: skip
def test_what_is_reduced_follows_the_zoom_in_the_middle(
    zoom: float, reduction: float | None, tilt: tuple[float, float]
) -> None:
    """Where the right photograph shows more detail, it is reduced, else the left one."""
    to_middle, tilted = np.eye(3), np.eye(3)
    to_middle[:2, 2] = -(SIZE[0] - 1) / 2, -(SIZE[1] - 1) / 2
    tilted[2, :2] = tilt
    for scale in (zoom, 1 / zoom):
        run = choose_run_between_octaves(np.diag([scale, scale, 1]) @ tilted @ to_middle, SIZE)
        if reduction is None:
            assert run is None
        else:
            assert run is not None
            (other,) = run.others
            assert (run.reference.scale, 1 / other.scale) == pytest.approx((math.sqrt(2), reduction))
            assert run.swapped == (scale < 1)


def test_ground_that_becomes_a_line_has_no_zoom() -> None:
    assert choose_run_between_octaves(np.diag([0.0, 1, 1]), SIZE) is None


def test_a_tilt_of_65_degrees_is_found_from_either_side() -> None:
    left, right, truth = flat_pair("tilt", 65, 11)
    for one, other, matrix in ((left, right, truth), (right, left, np.asarray(np.linalg.inv(truth), dtype=np.float64))):
        pair = register(one, other)
        assert pair.accepted, pair.reason
        assert grid_error(pair.homography, matrix, (640, 480), (640, 480)) < 1
        assert len(pair.inliers) > 100
        # The usual pass, one larger and one smaller, six for zooms, small ones with either photograph tilted, of which
        # one is too narrow, and the promising ones at full size.
        assert pair.passes == 1 + 2 + 6 + 2 * (len(TILTED) - 1) + MAX_PROMISING


@pytest.mark.parametrize(("number", "passes"), [(0, 2), (10, 3)])
def test_small_photographs_are_enlarged_with_a_margin(number: int, passes: int) -> None:
    """As larger ones, the first takes 10 passes, and the second is refused after 37."""
    left, right, truth = flat_pair("small", 25, number)
    pair = register(left, right)
    assert (pair.accepted, pair.passes) == (True, passes)
    assert grid_error(pair.homography, truth, (240, 180), (240, 180)) < 1


def test_an_overlap_of_a_few_percent_is_found_by_quarters_at_twice_the_size() -> None:
    """Whole, at twice the size, its few corners gather six inliers."""
    left, right, truth = flat_pair("horizon", 80, 0)
    pair = register(left, right)
    assert pair.accepted, pair.reason
    assert grid_error(pair.homography, truth, (640, 480), (640, 480)) < 0.5
    # The search is as usual until all tilts are tried.
    assert pair.passes >= 1 + 2 + 6 + 2 * (len(TILTED) - 1) + len(QUARTERS) ** 2
