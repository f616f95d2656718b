"""The tree is laid out as CONTRIBUTING says: a module's tests are found by its path."""

import ast
from pathlib import Path

ROOT = Path(__file__).parents[2]
MODULES = [
    path.relative_to(ROOT)
    for package in ("golden_model", "hdl")
    for path in sorted((ROOT / package).rglob("*.py"))
    if path.name != "__init__.py"
]


def computes(path: Path) -> bool:
    """Whether a module has logic: names of types and protocols have none."""
    nodes = ast.walk(ast.parse(path.read_text()))
    functions = [node for node in nodes if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)]
    return any(not isinstance(node.body[-1], ast.Expr) or len(node.body) > 1 for node in functions)


def test_a_module_with_logic_has_tests_at_its_path() -> None:
    assert len(MODULES) > 100
    tests = {module: ROOT / "tests" / module.parent / f"test_{module.name}" for module in MODULES}
    assert [str(module) for module in MODULES if computes(ROOT / module) and not tests[module].exists()] == []


def test_tests_are_of_a_module_or_of_help_beside_them() -> None:
    for package in ("golden_model", "hdl"):
        for path in sorted((ROOT / "tests" / package).rglob("test_*.py")):
            name = path.name.removeprefix("test_")
            module = ROOT / path.relative_to(ROOT / "tests").with_name(name)
            assert module.exists() or path.with_name(name).exists(), path
