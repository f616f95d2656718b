from pathlib import Path

from typer.testing import CliRunner

from skymosaic.cli.commands import app
from skymosaic.common.errors import InputError


def test_the_command_names_a_missing_list(tmp_path: Path) -> None:
    result = CliRunner().invoke(app, ["thesis", "--data", str(tmp_path), "-o", str(tmp_path / "out")])
    assert isinstance(result.exception, InputError)
    assert "pairs.csv" in str(result.exception)
