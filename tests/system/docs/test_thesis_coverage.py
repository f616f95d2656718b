"""docs/explanation/thesis_coverage.md names every row of the thesis, and only code and tests that exist."""

import ast
import importlib
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[3]
TABLE = ROOT / "docs" / "explanation" / "thesis_coverage.md"
REFERENCES = {
    "IV.6.2.1", "IV-1", "II-1", "III-6", "III-7", "III.6.1.1", "II.2.1.2, III.6.1.1", "II-2, II-3", "II-4 to II-6",
    "II-7", "II-8 to II-11", "III-1", "III-2", "III-3", "III-4", "III-5", "III.5.1", "III.5.2", "III-8, III-9, IV.2.4",
    "II-12 to II-15", "II-16", "II-17", "II.2.4", "II-18, A-1 to A-4", "III.6.4, III-10", "IV-2", "IV-3 to IV-5",
    "IV-6, IV-7", "Tables III-1, III-2", "fuzzy ILBP", "Table III-3", "Table IV-1", "Table IV-2", "Table IV-3",
    "Table IV-4", "Table IV-5", "Table IV-6", "Table IV-7", "Figure IV-6", "IV.6", "IV.6.1", "IV.6.3",
    "membership curves", "I.6.3.3", "II.3.2",
}  # fmt: skip


def rows() -> list[list[str]]:
    lines = [line for line in TABLE.read_text(encoding="utf-8").splitlines() if line.startswith("| ")]
    return [[cell.strip() for cell in line.strip("| ").split(" | ")] for line in lines[1:]]


def named(cell: str) -> list[str]:
    return re.findall(r"`([^`]+)`", cell)


def test_no_row_of_the_thesis_is_missing() -> None:
    assert {row[0] for row in rows()} == REFERENCES


@pytest.mark.parametrize("row", rows(), ids=lambda row: f"{row[0]} {row[1]}")
def test_what_a_row_names_exists(row: list[str]) -> None:
    code, tests = named(row[2]), named(row[3])
    assert code
    assert tests
    if all(name.startswith("tests.") for name in code):
        assert row[2].startswith("not offered"), "a user cannot reach what lies beside the tests"
    for name in code:
        module, symbol = name.rsplit(".", 1)
        assert hasattr(importlib.import_module(module), symbol), name
    for name in tests:
        path, test = name.split("::")
        tree = ast.parse((ROOT / path).read_text(encoding="utf-8"))
        assert test in {node.name for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)}, name
