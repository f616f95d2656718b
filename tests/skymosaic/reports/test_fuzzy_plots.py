import cv2
import numpy as np
import pytest

from skymosaic.reports.fuzzy_plots import draw_system
from skymosaic.reports.fuzzy_systems import PLOTTED_SYSTEMS

QUICK = ("aerial-turn", "ransac")


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.slow] * (name not in QUICK)) for name in PLOTTED_SYSTEMS]
)
def test_each_system_has_a_picture_with_curves_and_surface(name: str) -> None:
    decoded = cv2.imdecode(np.frombuffer(draw_system(PLOTTED_SYSTEMS[name]), np.uint8), cv2.IMREAD_COLOR)
    height, width = decoded.shape[:2]
    assert (height, width) > (600, 600)
    assert len(np.unique(decoded.reshape(-1, 3), axis=0)) > 50
