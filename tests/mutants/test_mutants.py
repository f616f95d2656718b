"""Wrong lines are wrong in one place, and the tests that see a file are found."""

import ast
import contextlib
import io
import json
from pathlib import Path

import pytest

from tests.mutants.mutants import find_mutants, main

SOURCE = '''"""Docstrings, True and 1 in texts, are left alone."""

def clamp(x: int = 3, *, strict: bool = False) -> bool:
    if not strict and (x + 1) * 2 >= min(x, 7):
        raise ValueError(f"{x + 1} is not valid")
    return all(y is not None for y in (x, x % 2))
'''


def test_each_mutant_is_one_other_program() -> None:
    found = find_mutants(Path("a.py"), SOURCE.encode())
    texts = {mutant.apply(SOURCE.encode()).decode() for mutant in found}
    assert len(texts) == len(found)
    assert all(ast.dump(ast.parse(text)) != ast.dump(ast.parse(SOURCE)) for text in texts)
    for before, after in {
        "x: int = 3": "x: int = 4",
        "strict: bool = False": "strict: bool = True",
        "not strict and": "not strict or",
        "if not strict and (x + 1) * 2 >= min(x, 7)": "if (not (not strict and (x + 1) * 2 >= min(x, 7)))",
        "(x + 1) * 2": "(x - 1) * 2",
        "(x + 1) * 2 ": "(x + 1) / 2 ",
        ">= min": "> min",
        "min(x": "max(x",
        "all(y": "any(y",
        "y is not None": "y is None",
        "x % 2": "x * 2",
    }.items():
        assert SOURCE.replace(before, after, 1) in texts, after
    assert not any("valid" not in text or "x - 1} is" in text or "Docstrings, False" in text for text in texts)
    (described,) = (each.describe(SOURCE.encode()) for each in found if "any(" in each.describe(SOURCE.encode()))
    assert all(SOURCE.count(each.old) == 1 and each.path == Path("a.py") for each in found)
    assert described.startswith("a.py:6: return all(y is not None for y in (x, x % 2))  ->  return any(y is not None")


def test_a_list_is_written_and_replayed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    tests = "def test_it():\n    import code_of_tree\n    assert code_of_tree.x == 1\n"
    for name, text in {"code_of_tree.py": "x = 1\ny = 1\n", "test_a.py": tests}.items():
        (tmp_path / name).write_text(text)
    monkeypatch.setattr("tests.mutants.mutants.ROOT", tmp_path)
    monkeypatch.setattr("tests.mutants.mutants._list_files", lambda *_: [Path("code_of_tree.py")])
    monkeypatch.setattr("tests.mutants.mutants.choose_tests", lambda _: [Path("test_a.py")])
    monkeypatch.setattr("sys.argv", ["mutants", "--list", str(tmp_path / "list.json"), "--seed", "1"])
    main()
    path, old, new, noticed = min(json.loads((tmp_path / "list.json").read_text()))
    assert (path, old, new) == ("code_of_tree.py", "x = 1", "x = 2")
    assert noticed.startswith("FAILED test_a.py::test_it")
    (tmp_path / "code_of_tree.py").rename(tmp_path / "other.py")
    (tmp_path / "test_a.py").write_text(tests.replace("code_of_tree", "other"))
    monkeypatch.setattr("tests.mutants.mutants._list_files", lambda *_: [Path("other.py")])
    replayed = io.StringIO()
    with contextlib.redirect_stdout(replayed):
        main()
    assert "other.py:1: x = 1  ->  x = 2: FAILED" in replayed.getvalue()
    assert replayed.getvalue().endswith("1 of 2 noticed; not:\nother.py:2: y = 1  ->  y = 2\n")
