"""The command line that the panel shows beside a result repeats that result."""

import shlex
from pathlib import Path

import cv2
import numpy as np
import pytest
from typer.testing import CliRunner

from sim.backends.interface import silent
from sim.scene import make_pair
from skymosaic.cli import app
from skymosaic.panel.options import Options
from skymosaic.panel.tasks.mosaic_tasks import compare_hardware, make_mosaic

OPTIONS = {
    "preset": {},
    "threshold": {"position": 26, "rule_base": "none", "blending": "average"},
    "fast": {"detector": "fast", "position": 25, "descriptor": "ilbp-256"},
    "key points": {"detector": "brisk", "descriptor": "freak"},
    "fewer key points": {"detector": "orb", "position": 16, "blending": "multiband"},
    "damaged": {"damaged": "keep", "detector": "fast", "position": 9},
    "refined": {"estimator": "magsac", "refine": True},
    "fuzzy estimator": {"estimator": "fuzzy-ransac"},
}


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """The folder of a run for each of `OPTIONS`."""
    images = make_pair(seed=9, size=(400, 300)).images
    folders = {name: tmp_path_factory.mktemp("run") for name in OPTIONS}
    for name, folder in folders.items():
        options = Options.of_preset("aerial")
        for option, value in OPTIONS[name].items():
            options = options.changed(option, value)
        (folder / "views").mkdir()
        for number, image in enumerate(images):
            cv2.imwrite(str(folder / f"{number}.png"), image)
        result = make_mosaic(folder, ["0.png", "1.png"], options, folder / "views", progress=silent)
        assert result.mosaic is not None, result.reason
    return folders


@pytest.mark.parametrize("name", OPTIONS)
def test_the_command_of_a_pair_repeats_its_mosaic(
    runs: dict[str, Path], name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(runs[name])
    before = Path("mosaic.png").rename("before.png")
    program, *arguments = shlex.split(Path("command.txt").read_text())
    assert program == "skymosaic"
    result = CliRunner().invoke(app, arguments)
    assert result.exception is None, result.output
    assert np.array_equal(*(cv2.imread(name) for name in ("mosaic.png", str(before))))


def test_every_option_changes_the_mosaic(runs: dict[str, Path]) -> None:
    """Otherwise a command that ignored the options would pass the test above."""
    assert len({(folder / "mosaic.png").read_bytes() for folder in runs.values()}) == len(runs)


def test_the_files_of_a_run_do_not_name_its_folder(runs: dict[str, Path]) -> None:
    """The archive is opened elsewhere and must not reveal where the panel keeps its files."""
    for folder in runs.values():
        texts = [path for path in folder.rglob("*") if path.suffix in (".csv", ".html", ".json", ".toml", ".txt")]
        assert len(texts) == 6
        assert not any(str(folder) in path.read_text() for path in texts)


def test_a_damaged_photograph_that_is_kept_is_compared_too(tmp_path: Path) -> None:
    images = make_pair(seed=9, size=(400, 300)).images
    for number, image in enumerate(images):
        cv2.imwrite(str(tmp_path / f"{number}.jpg"), image)
    data = bytearray((tmp_path / "0.jpg").read_bytes())
    data[len(data) // 2 : len(data) // 2 + 400] = bytes(400)
    (tmp_path / "0.jpg").write_bytes(data)
    options = Options.of_preset("aerial").changed("damaged", "keep")
    # The model itself stands in for the hardware.
    found = compare_hardware(tmp_path, ("0.jpg", "1.jpg"), options, "golden", progress=silent)
    assert found.comparison.mismatch is None
    assert "--damaged keep" in found.command
