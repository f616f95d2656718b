from pathlib import Path

import cv2
import numpy as np
import pytest
from typer.testing import CliRunner

from skymosaic.cli import app
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


@pytest.mark.parametrize("name", PLOTTED_SYSTEMS)
def test_portraits_fit_their_systems(name: str) -> None:
    plotted = PLOTTED_SYSTEMS[name]
    inputs = len(plotted.system().inputs)
    assert len(plotted.axes) == inputs
    assert set(plotted.surface) <= set(range(inputs))
    assert (len(plotted.sections) > 1) == (inputs > 2)


def test_the_command_prints_rules_and_draws(tmp_path: Path) -> None:
    result = CliRunner().invoke(app, ["fuzzy", "ransac", "--plot", "-o", str(tmp_path / "fuzzy")])
    assert result.exit_code == 0, result.output
    assert "not verified" in result.output
    assert [path.name for path in (tmp_path / "fuzzy").iterdir()] == ["ransac.png"]


def test_an_unknown_system_lists_the_valid_ones() -> None:
    result = CliRunner().invoke(app, ["fuzzy", "psychic"])
    assert "correlation, ilbp, ransac" in str(result.exception)
