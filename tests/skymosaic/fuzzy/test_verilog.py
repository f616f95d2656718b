"""Verilog of anyone's rules: simulated by Icarus from the exported files alone, against the integer model."""

import re
import shutil
from pathlib import Path

import pytest
from typer.testing import CliRunner

from skymosaic.cli import app
from skymosaic.errors import InputError
from skymosaic.fuzzy.files import SHIPPED
from tests.hdl.blocks.test_export import simulate

VALVE = """FUNCTION_BLOCK valve
FUZZIFY temp
  TERM cold := (3, 1) (27, 0);
  TERM hot := (3, 0) (27, 1);
END_FUZZIFY
FUZZIFY pressure
  TERM low := (55, 1) (95, 0);
  TERM high := (55, 0) (95, 1);
END_FUZZIFY
DEFUZZIFY valve
  TERM drainage := -100;
  TERM closed := 0;
  TERM inlet := 100;
  METHOD : COGS;
END_DEFUZZIFY
RULEBLOCK rules
  AND : PROD;
  RULE 1 : IF temp IS cold AND pressure IS low THEN valve IS inlet;
  RULE 2 : IF temp IS cold AND pressure IS high THEN valve IS closed;
  RULE 3 : IF temp IS hot AND pressure IS low THEN valve IS closed;
  RULE 4 : IF temp IS hot AND pressure IS high THEN valve IS drainage;
END_RULEBLOCK
END_FUNCTION_BLOCK
"""
ONE_INPUT = re.sub(
    r"FUZZIFY pressure.*?END_FUZZIFY\n|  RULE [23].*?\n| AND pressure IS \w+", "", VALVE, flags=re.DOTALL
)
BOOLEAN = "FUZZIFY {}\n  TERM low := (0, 1) (1, 0);\n  TERM high := (0, 0) (1, 1);\nEND_FUZZIFY\n"
FOUR_INPUTS = VALVE.replace("DEFUZZIFY valve", "".join(map(BOOLEAN.format, "ab")) + "DEFUZZIFY valve")


def export(folder: Path, *options: object) -> None:
    words = ["export", "--block", "fuzzy", *map(str, options), "-o", str(folder)]
    CliRunner().invoke(app, words, standalone_mode=False, catch_exceptions=False)


@pytest.mark.skipif(shutil.which("iverilog") is None, reason="iverilog is absent")
@pytest.mark.parametrize(
    ("rules", "entries"),
    [(VALVE, 64), (VALVE, 41), (ONE_INPUT, 16), (SHIPPED / "correlation.fll", 100), (SHIPPED / "ransac.fll", 64)],
    ids=["product", "no power of two", "one input", "27 rules", "two inputs, minimum"],
)
def test_the_bench_of_own_rules_passes(tmp_path: Path, rules: str | Path, entries: int) -> None:
    path = rules if isinstance(rules, Path) else tmp_path / "rules.fcl"
    if isinstance(rules, str):
        path.write_text(rules)
    export(tmp_path / "out", "--rules", path, "--entries", entries)
    run = simulate(tmp_path / "out", "fuzzy")
    assert run.returncode == 0, run.stdout
    assert run.stdout.startswith("PASS: 403 answers")
    readme = (tmp_path / "out" / "README.md").read_text()
    assert f"and {entries - 1} for" in readme
    answers = (tmp_path / "out" / "o.hex").read_text().split()
    assert len(set(answers)) > 3


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (("--entries", 5000), "at most 4096"),
        (("--rules", "four.fcl", "--entries", 16), "multiplies at most 3"),
        (("--block", "harris"), "add --block fuzzy"),
        (("--lanes", 8), "no option of the whole accelerator"),
        (("--rules", "missing.fll"), "missing.fll: cannot be read"),
    ],
)
def test_what_hardware_cannot_be_is_said_in_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, options: tuple[object, ...], says: str
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("valve.fcl").write_text(VALVE.replace("PROD", "MIN"))
    Path("four.fcl").write_text(FOUR_INPUTS)
    with pytest.raises(InputError, match=re.escape(says)):
        export(tmp_path / "out", "--rules", "valve.fcl", *options)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["four.fcl", "valve.fcl"]
