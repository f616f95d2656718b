"""Fuzzy systems as text, as tables and as Verilog."""

import re
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from golden_model.fuzzy.fll import load_system
from golden_model.fuzzy.rules import SHIPPED
from golden_model.fuzzy.system import FuzzySystem, IfThen, Input, Output
from golden_model.fuzzy.terms import Term
from skymosaic.cli.commands import app
from skymosaic.common.errors import InputError
from skymosaic.fuzzy.quantised import measure_errors, quantise
from tests.golden_model.fuzzy.tipper import TIPPER
from tests.golden_model.fuzzy.valve import PRODUCT, VALVE
from tests.hdl.blocks.test_export import simulate


@pytest.mark.parametrize(("name", "entries"), [("correlation", 64), ("ilbp", 17), ("ransac", 17), ("ransac", 64)])
def test_the_errors_stay_within_the_bound(name: str, entries: int) -> None:
    quantised = quantise(load_system(SHIPPED / f"{name}.fll"), entries)
    rng = np.random.default_rng(2)
    indices = rng.integers(0, entries, (len(quantised.real.inputs), 5000))
    values = [quantised.positions(v)[index] for v, index in zip(quantised.real.inputs, indices, strict=True)]
    total = quantised.real.strengths(*values).sum(axis=1)
    fires = quantised.model.strengths(*indices).sum(axis=1) > 0
    difference = np.abs(quantised.evaluate(*indices)[fires] - quantised.real.evaluate(*values)[fires])
    bound = (len(quantised.real.rules) / np.maximum(total[fires], 1e-9) + 2) / 512
    assert (difference <= bound).all()
    errors = measure_errors(quantised)
    assert errors.largest >= difference.max() - 1e-12
    assert errors.mean <= errors.firm <= errors.largest
    assert errors.complete == (entries ** len(quantised.real.inputs) <= 1 << 18)


def corners(*slopes: tuple[float, float]) -> FuzzySystem:
    """Four rules of a product over two inputs with two terms each that sum to one only if the slopes are opposite."""
    inputs = tuple(
        Input(name, 0.0, 1.0, {"low": Term("low", "Ramp", slopes[0]), "high": Term("high", "Ramp", slopes[1])})
        for name in ("x", "y")
    )
    rules = tuple(IfThen({"x": x, "y": y}, f"{x}_{y}") for x in ("low", "high") for y in ("low", "high"))
    constants = {"low_low": 0.0, "low_high": 10.0, "high_low": 20.0, "high_high": 40.0}
    return FuzzySystem("corners", inputs, Output("z", 0.0, 40.0, constants), rules, "product")


def test_a_product_of_terms_that_sum_to_one_needs_no_division() -> None:
    errors = measure_errors(quantise(corners((1.0, 0.0), (0.0, 1.0)), 100))
    assert errors.complete
    assert errors.largest < 3 / 256
    with pytest.raises(ValueError, match="strengths sum to"):
        quantise(corners((1.0, 0.0), (0.0, 0.5)), 100)


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
    ("rules", "entries", "name", "first"),
    [
        (PRODUCT, 41, "fuzzy_valve", "temp"),
        (ONE_INPUT, 16, "fuzzy_valve", "temp"),
        pytest.param(SHIPPED / "correlation.fll", 100, "fuzzy_correlation", "SAD", marks=pytest.mark.slow),
        (SHIPPED / "ransac.fll", 64, "fuzzy_ransac", "check"),
    ],
    ids=["product, no power of two", "one input", "27 rules", "two inputs, minimum"],
)
def test_the_bench_of_own_rules_passes(tmp_path: Path, rules: str | Path, entries: int, name: str, first: str) -> None:
    path = rules if isinstance(rules, Path) else tmp_path / "rules.fll"
    if isinstance(rules, str):
        path.write_text(rules)
    export(tmp_path / "out", path, "--entries", entries)
    run = simulate(tmp_path / "out", name)
    assert run.returncode == 0, run.stdout
    assert run.stdout.startswith("PASS: 403 answers")
    readme = (tmp_path / "out" / "README.md").read_text()
    assert f"and {entries - 1} for" in readme
    bits = len(f"{entries - 1:b}")
    assert f"input [{bits - 1}:0] i_{first};" in (tmp_path / "out" / f"{name}.v").read_text()
    answers = (tmp_path / "out" / "o.hex").read_text().split()
    assert len(set(answers)) > 3


@pytest.mark.needs("icarus")
def test_two_systems_stand_in_one_design(tmp_path: Path) -> None:
    """Modules, cores and ports have names of their own: those of MATLAB's system, and of one that is hard to name."""
    (tmp_path / "tipper.fis").write_text(TIPPER)
    hard = VALVE.replace("valve", "in Löwen-Bad 2", 1).replace("pressure", "next").replace("temp", "Größe")
    (tmp_path / "hard.fll").write_text(hard.replace("valve", "rule"))
    names = {"tipper.fis": "fuzzy_tipper", "hard.fll": "fuzzy_in_L_wen_Bad_2"}
    modules: list[str] = []
    for file, name in names.items():
        export(tmp_path / name, tmp_path / file, "--entries", 16)
        assert simulate(tmp_path / name, name).stdout.startswith("PASS: 403 answers")
        assert f"vision:{name}:" in (tmp_path / name / f"{name}.core").read_text()
        modules += re.findall(r"^module (\S+?)[ (]", (tmp_path / name / f"{name}.v").read_text(), re.MULTILINE)
    assert len(modules) == len(set(modules)) > 3
    ports = set(re.findall(r"`(\w+)` \| (?:in|out)", (tmp_path / names["hard.fll"] / "README.md").read_text()))
    assert {"i_Gr__e", "i_next_", "o_rule_", "o_rule"} <= ports


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
