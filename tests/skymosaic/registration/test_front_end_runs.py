import math

import numpy as np
import pytest

from skymosaic.registration.front_end_runs import choose_run_between_octaves

SIZE = (321, 241)


@pytest.mark.parametrize("tilt", [(0, 0), (2e-3, -1e-3)])
@pytest.mark.parametrize(
    ("zoom", "reduction"),
    [(0.9, None), (1.1, None), (2.1, None), (1.2, 2), (math.sqrt(2), 2), (3, 2), (4, math.sqrt(8))],
)
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
