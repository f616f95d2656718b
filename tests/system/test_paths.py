"""Where tests lie: at the path of what they test, code or a helper of tests, in the file that a folder's small modules
share and that has its name, or among the tests of several parts.

In the golden model and the hardware, whatever computes has tests at its path.
"""

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
SHARED = ("rows", "refusals")
"""Files of tests that the modules of a folder share beside the one of the folder's name."""
OF_SEVERAL_PARTS = ("tests/system", "tests/formal", "tests/cocotb", "tests/fuzz")


def find_misplaced(root: Path) -> list[str]:
    """Test files whose path, without ``tests/`` and ``test_``, names no code, folder or helper."""
    misplaced = []
    for test in sorted((root / "tests").rglob("test_*.py")):
        path = test.relative_to(root)
        tested = root / path.relative_to("tests").with_name(test.stem.removeprefix("test_"))
        if not path.as_posix().startswith(OF_SEVERAL_PARTS) and not [
            *tested.parent.glob(f"{tested.name}.*"),
            *tested.parent.glob(tested.name),
            *test.parent.glob(f"{tested.name}.py"),
            *(name for name in (test.parent.name, *SHARED) if name == tested.name),
        ]:
            misplaced.append(path.as_posix())
    return misplaced


def test_tests_lie_at_the_path_of_the_code_that_they_test() -> None:
    assert find_misplaced(ROOT) == []


@pytest.mark.parametrize(
    ("name", "misplaced"),
    [("test_harris.py", []), ("test_hdl.py", []), ("test_colour.py", ["tests/hdl/test_colour.py"])],
)
def test_a_misplaced_test_is_found(tmp_path: Path, name: str, misplaced: list[str]) -> None:
    for path in ("hdl/harris.py", f"tests/hdl/{name}", "tests/system/test_colour.py"):
        (tmp_path / path).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / path).touch()
    assert find_misplaced(tmp_path) == misplaced


def computes(path: Path) -> bool:
    """Whether a module has logic: names of types and protocols have none."""
    nodes = ast.walk(ast.parse(path.read_text()))
    functions = [node for node in nodes if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)]
    return any(not isinstance(node.body[-1], ast.Expr) or len(node.body) > 1 for node in functions)


def test_every_module_of_model_and_hardware_that_computes_has_tests_at_its_path() -> None:
    modules = [path for package in ("golden_model", "hdl") for path in sorted((ROOT / package).rglob("*.py"))]
    computing = [path.relative_to(ROOT) for path in modules if path.stem != "__init__" and computes(path)]
    assert len(computing) > 100
    assert [path for path in computing if not _is_tested(path)] == []


def _is_tested(path: Path) -> bool:
    """Whether there are tests beside a module, or a file of its folder's tests names it."""
    beside = ROOT / "tests" / path.with_name(f"test_{path.name}")
    others = (each.read_text(encoding="utf-8") for each in beside.parent.glob("test_*.py"))
    return beside.exists() or any(re.search(rf"\b{path.stem}\b", text) for text in others)


def test_the_tests_of_a_file_run_in_one_process(request: pytest.FixtureRequest) -> None:
    """Otherwise each process makes what they share: pytest-xdist is silent about groups that it does not see."""
    name = request.node.nodeid
    assert name.endswith("@" + name.partition("::")[0]) or not request.config.getoption("loadgroup", False)
