"""What a template is without a front end: its size in the view."""

from typing import Any

import numpy as np
import pytest

from skymosaic.geometry.homography import apply
from skymosaic.tracking.template import MARGIN_PX, Roi, Template


@pytest.mark.parametrize(
    ("sides", "zoom"), [((64, 64), 2.0), ((32, 128), 2.0), ((128, 128), 1.0), ((200, 150), 1.0), ((1024, 256), 0.5)]
)
def test_a_view_shows_an_object_at_a_size_that_has_features(sides: tuple[int, int], zoom: float) -> None:
    nothing: Any = None
    template = Template(np.zeros((300, 1100), np.uint8), Roi(20, 30, *sides), nothing, nothing)
    assert template.zoom == pytest.approx(zoom)
    shown = template.first_view.picture.shape[1::-1]
    assert shown == tuple(round(zoom * side) + 2 * MARGIN_PX for side in sides)
    # The middles of its first and its last pixel, with the surroundings around it.
    middle, corner = apply(template._to_view, np.array([np.subtract(sides, 1) / 2, [-0.5, -0.5]]))
    np.testing.assert_allclose(middle, (np.array(shown) - 1) / 2, atol=0.51)
    weight = template._weight_at(np.array([middle, corner, corner - 0.01]))
    np.testing.assert_allclose(weight, [1, np.exp(-2), 0], atol=1e-9)
    np.testing.assert_allclose(template.in_picture @ [0, 0, 1], [20, 30, 1])
