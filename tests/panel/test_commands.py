"""The command line that the panel shows beside a result makes that result again."""

import shlex
from contextlib import chdir
from pathlib import Path

import cv2
import numpy as np
import pytest
from typer.testing import CliRunner

from sim.backend import silent
from sim.scene import pair as rendered_pair
from skymosaic.cli import app
from skymosaic.panel.mosaic_tasks import make_mosaic
from skymosaic.panel.options import Choices

CHOICES = {
    "preset": {},
    "threshold": {"position": 12, "rule_base": "none", "blending": "average"},
    "fast": {"detector": "fast", "position": 25, "descriptor": "ilbp-256"},
    "key points": {"detector": "brisk", "descriptor": "freak"},
    "strongest of the host": {"detector": "orb", "position": 16, "blending": "multiband"},
    "refined": {"estimator": "magsac", "refine": True},
    "fuzzy estimator": {"estimator": "fuzzy-ransac"},
}


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """The folder of a run for each of `CHOICES`."""
    images = rendered_pair(seed=9, size=(400, 300)).images
    folders = {name: tmp_path_factory.mktemp("run") for name in CHOICES}
    for name, folder in folders.items():
        choices = Choices.of_preset("aerial")
        for choice, value in CHOICES[name].items():
            choices = choices.changed(choice, value)
        (folder / "views").mkdir()
        with chdir(folder):
            for number, image in enumerate(images):
                cv2.imwrite(f"{number}.png", image)
            outcome = make_mosaic(["0.png", "1.png"], choices, folder / "views", progress=silent)
        assert outcome.mosaic is not None, outcome.reason
    return folders


@pytest.mark.parametrize("name", CHOICES)
def test_a_pairs_command_repeats_it(runs: dict[str, Path], name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(runs[name])
    before = Path("mosaic.png").rename("before.png")
    program, *arguments = shlex.split(Path("command.txt").read_text())
    assert program == "skymosaic"
    result = CliRunner().invoke(app, arguments)
    assert result.exception is None, result.output
    assert np.array_equal(*(cv2.imread(name) for name in ("mosaic.png", str(before))))


def test_every_choice_changes_what_is_made(runs: dict[str, Path]) -> None:
    """Else the comparison above would prove nothing."""
    assert len({(folder / "mosaic.png").read_bytes() for folder in runs.values()}) == len(runs)
