import numpy as np
import pytest

from skymosaic.common.errors import RegistrationError
from skymosaic.flight.picture.rig import _fit
from skymosaic.geometry.homography import apply
from tests.skymosaic.flight.picture.conftest import SIZE

GRID = np.stack(np.meshgrid(np.linspace(0, SIZE[0] - 1, 5), np.linspace(0, SIZE[1] - 1, 5)), -1).reshape(-1, 2)


@pytest.mark.parametrize(
    ("captures", "says"),
    [
        ([(20, 0), (20, 0)], ""),
        ([(20, 0), (19, 0)], "39 of 39 places in 2 captures agree"),
        ([(26, 24), (26, 24)], ""),
        ([(20, 31), (20, 31)], "40 of 102 places in 2 captures agree"),
        ([(9, 0)] * 5, "none of 5 captures shows 10 places in both"),
        ([(10, 0), *[(9, 0)] * 4], ""),
        ([(40, 0), (15, 0, 4)], r"it lies [34]\.\d px off in one capture; the cameras of a rig must be fixed"),
        ([(40, 0), (15, 0, 0.5)], ""),
        ([(40, 0), (9, 0, 4)], ""),
    ],
)  # fmt: skip
def test_a_rig_is_fixed_if_enough_places_of_each_capture_agree(captures: list[tuple[float, ...]], says: str) -> None:
    rng, places = np.random.default_rng(0), []
    for true, false, *off in captures:
        here = rng.uniform(0, 600, (int(true + false), 2))
        there = here + np.array([7 + sum(off), -3])
        there[int(true) :] = rng.uniform(0, 600, (int(false), 2))
        places.append((here, there, np.ones(len(here))))
    twice = np.diag([2.0, 2.0, 1.0])
    if says:
        with pytest.raises(RegistrationError, match=f"^band red cannot be aligned with band green: {says}"):
            _fit("red", "green", places, twice)
        return
    found = _fit("red", "green", places, twice)
    np.testing.assert_allclose(apply(found.homography, GRID), GRID - [14, -6], atol=0.5)
    assert found.error_px < 2
    # The median of an exact capture and of one that is half a pixel off; the photographs are twice as large.
    assert (0.3 < found.error_px < 0.5) is (captures[-1] == (15, 0, 0.5))
