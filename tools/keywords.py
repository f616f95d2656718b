"""Writes the types of options as keyword arguments, for type checkers alone: ``python -m tools.keywords``."""

import ast
import dataclasses
import inspect
import sys
from pathlib import Path
from typing import Any

from skymosaic import FeatureOptions, LiveOptions, MosaicOptions, RegistrationOptions, TrackerOptions

STUB = Path(__file__).parents[1] / "skymosaic" / "keywords.pyi"
HEAD = """# Written by `python -m tools.keywords`.
# fmt: off
# ruff: noqa
# mypy: disable-error-code="attr-defined"
"""
CLASSES = (FeatureOptions, RegistrationOptions, MosaicOptions, LiveOptions, TrackerOptions)


def describe_keywords() -> str:
    """A `TypedDict` for each class of options, with the fields and annotations of its declaration."""
    imported, classes = set[str](), list[str]()
    for options in CLASSES:
        lines = [f"\nclass {options.__name__.removesuffix('Options')}Keywords(TypedDict, total=False):\n"]
        annotations = [_annotations(base) for base in options.__mro__]
        for field in dataclasses.fields(options):
            annotation, module = next(each[field.name] for each in annotations if field.name in each)
            names = {node.id for node in ast.walk(annotation) if isinstance(node, ast.Name)}
            imported |= {f"from {module} import {name}\n" for name in names & vars(sys.modules[module]).keys()}
            lines.append(f"    {field.name}: {ast.unparse(annotation)}\n")
        classes.append("".join(lines))
    return "".join([HEAD, "from typing import TypedDict\n\n", *sorted(imported), *classes])


def _annotations(cls: type[Any]) -> dict[str, tuple[ast.expr, str]]:
    """The annotations in the body of a class, and its module, by the names of the fields."""
    if not dataclasses.is_dataclass(cls):
        return {}
    (body,) = ast.parse(inspect.getsource(cls)).body
    assert isinstance(body, ast.ClassDef)
    fields = [each for each in body.body if isinstance(each, ast.AnnAssign) and isinstance(each.target, ast.Name)]
    return {ast.unparse(each.target): (each.annotation, cls.__module__) for each in fields}


if __name__ == "__main__":
    STUB.write_text(describe_keywords(), encoding="utf-8")
