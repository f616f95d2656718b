import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from golden_model.fuzzy.rules import SHIPPED
from skymosaic.cli.commands import app
from skymosaic.common.errors import InputError


@pytest.mark.parametrize(
    ("words", "says"),
    [
        ("a/own.fll b/own.fll --plot -o drawn", "b/own.fll: its picture would replace that of a/own.fll"),
        ("ransac ransac --plot", "ransac: its picture would replace that of ransac"),
        ("ransac ransac.fll --plot", "ransac.fll: its picture would replace that of ransac"),
        ("ransac -o drawn", "add --plot"),
        ("ransac --plot -o ransac.fll --overwrite", "ransac.fll: is no folder"),
        ("ransac --entries 9", "name one, or leave it out"),
    ],
)
def test_what_would_have_no_effect_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, words: str, says: str
) -> None:
    monkeypatch.chdir(tmp_path)
    for path in map(Path, ("a/own.fll", "b/own.fll", "ransac.fll")):
        path.parent.mkdir(exist_ok=True)
        path.write_bytes((SHIPPED / "ransac.fll").read_bytes())
    before = sorted(tmp_path.iterdir())
    result = CliRunner().invoke(app, ["fuzzy", *words.split()])
    assert isinstance(result.exception, InputError)
    assert says in str(result.exception)
    assert sorted(tmp_path.iterdir()) == before


def test_an_unknown_system_lists_the_valid_ones() -> None:
    result = CliRunner().invoke(app, ["fuzzy", "psychic"])
    assert "correlation, ilbp, ransac" in str(result.exception)


def test_the_command_writes_draws_and_measures_a_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("matplotlib")
    monkeypatch.chdir(tmp_path)
    run = CliRunner().invoke
    written = run(app, ["fuzzy", "correlation", "--write", "my.fll"])
    assert written.exception is None, written.output
    text = Path("my.fll").read_text()
    # No formula of matplotlib, and no markup of Rich.
    Path("my.fll").write_text(text.replace("Engine: ", r"Engine: $\frac$ [red]x[/blue] ", 1))
    shown = run(app, ["fuzzy", "my.fll", "--plot", "-o", "drawn", "--entries", "17", "--json"])
    assert shown.exception is None, shown.output
    (numbers,) = json.loads(shown.stdout)["systems"]
    assert len(numbers["rules"]) == 27
    assert numbers["errors"]["checked"] == 17**3
    assert len(numbers["tables"]["SAD"]["good"]) == 17
    assert (tmp_path / "drawn" / "my.png").stat().st_size > 10_000
    assert run(app, ["fuzzy", "ransac", "--write", "-"]).stdout == (SHIPPED / "ransac.fll").read_text()
    assert run(app, ["fuzzy", "aerial", "--write", "a.fll"]).exception is None
    assert isinstance(run(app, ["fuzzy", "valve", "--write", "b.fll"]).exception, InputError)
