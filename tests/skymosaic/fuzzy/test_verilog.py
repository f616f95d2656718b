"""Verilog of your own rules: simulated by Icarus from the exported files alone, against the integer model."""

import re
from pathlib import Path

import pytest
from typer.testing import CliRunner

from golden_model.fuzzy.rules import SHIPPED
from skymosaic.cli.commands import app
from skymosaic.common.errors import InputError
from tests.golden_model.fuzzy.valve import PRODUCT, VALVE
from tests.hdl.blocks.test_export import simulate

ONE_INPUT = re.sub(
    r"InputVariable: pressure.*?(?=OutputVariable)|  rule: if[^\n]*closed\n| (and|AND) \(?pressure \w+ \w+\)?",
    "",
    PRODUCT,
    flags=re.DOTALL,
)
BOOLEAN = "InputVariable: {}\n  range: 0 1\n  term: low Ramp 1 0\n  term: high Ramp 0 1\n"
FOUR_INPUTS = PRODUCT.replace("OutputVariable", "".join(map(BOOLEAN.format, "ab")) + "OutputVariable")


def export(folder: Path, *words: object) -> None:
    command = ["export", "fuzzy", *map(str, words), "-o", str(folder)]
    CliRunner().invoke(app, command, standalone_mode=False, catch_exceptions=False)


@pytest.mark.needs("icarus")
@pytest.mark.parametrize(
    ("rules", "entries"),
    [
        (PRODUCT, 41),
        (ONE_INPUT, 16),
        pytest.param(SHIPPED / "correlation.fll", 100, marks=pytest.mark.slow),
        (SHIPPED / "ransac.fll", 64),
    ],
    ids=["product, no power of two", "one input", "27 rules", "two inputs, minimum"],
)
def test_the_bench_of_own_rules_passes(tmp_path: Path, rules: str | Path, entries: int) -> None:
    path = rules if isinstance(rules, Path) else tmp_path / "rules.fll"
    if isinstance(rules, str):
        path.write_text(rules)
    export(tmp_path / "out", path, "--entries", entries)
    run = simulate(tmp_path / "out", "fuzzy")
    assert run.returncode == 0, run.stdout
    assert run.stdout.startswith("PASS: 403 answers")
    readme = (tmp_path / "out" / "README.md").read_text()
    assert f"and {entries - 1} for" in readme
    bits = len(f"{entries - 1:b}")
    assert f"input [{bits - 1}:0] i_0;" in (tmp_path / "out" / "fuzzy.v").read_text()
    answers = (tmp_path / "out" / "o.hex").read_text().split()
    assert len(set(answers)) > 3


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("valve.fll", "--entries", 5000), "valve.fll: cannot be made of hardware: entries is 5000; hardware takes at"),
        (("four.fll", "--entries", 16), "multiplies at most 3"),
        (("missing.fll",), "missing.fll: cannot be read"),
    ],
)
def test_what_hardware_cannot_be_is_said_in_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, words: tuple[object, ...], message: str
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("valve.fll").write_text(VALVE)
    Path("four.fll").write_text(FOUR_INPUTS)
    with pytest.raises(InputError, match=re.escape(message)):
        export(tmp_path / "out", *words)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["four.fll", "valve.fll"]
