from pathlib import Path

import cv2
import pytest
from typer.testing import CliRunner

from skymosaic.cli.commands import app
from skymosaic.common.errors import InputError
from skymosaic.evaluation.known_pairs import COLUMNS
from skymosaic.thesis.dataset import list_sources


@pytest.mark.slow
def test_the_command_writes_page_and_measurements(tmp_path: Path) -> None:
    pair = list_sources(None)[0]()
    for side, image in (("left", pair.left), ("right", pair.right)):
        cv2.imwrite(str(tmp_path / f"{side}.png"), image)
    values = ",".join(map(repr, pair.truth.ravel().tolist()))
    (tmp_path / "pairs.csv").write_text(f"{','.join(COLUMNS)}\nonly,real,left.png,right.png,{values}\n")
    result = CliRunner().invoke(app, ["thesis", "--data", str(tmp_path), "-o", str(tmp_path / "out")])
    assert result.exit_code == 0, result.output
    assert {path.name for path in (tmp_path / "out").iterdir()} == {"index.html", "measurements.csv"}


def test_the_command_names_a_missing_list(tmp_path: Path) -> None:
    result = CliRunner().invoke(app, ["thesis", "--data", str(tmp_path), "-o", str(tmp_path / "out")])
    assert isinstance(result.exception, InputError)
    assert "pairs.csv" in str(result.exception)
