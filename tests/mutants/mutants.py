"""Wrong lines that the tests should notice: ``make test-mutants``, or ``python -m tests.mutants.mutants``.

A sample of places in the code is made wrong, one at a time and in a copy of the tree, and the fast tests run that lie
beside the file and that reach it. Who reads the survivors decides: a user would notice it, so a test is missing; or the
line does the same as before, or only costs time.

With ``--list FILE`` the sample is kept as text, with the test that noticed each place, and the same command replays it
later: a place is found by its lines, wherever they are by then.
"""

import argparse
import ast
import dataclasses
import json
import os
import random
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from functools import cache, partial
from pathlib import Path

from golden_model.code_digest import digest_each

ROOT = Path(__file__).parents[2]
PACKAGES = ("golden_model", "hdl", "sim", "skymosaic")
MAX_REACHING = 8
"""So many test files of other folders run that reach the line: those that name it, then those that import least."""
ROWS = Path("tests/hdl/blocks/test_catalogue.py")
SECONDS = 600
"""Tests that take longer hang: the mutant is noticed."""
SWAPS: dict[type[ast.AST], tuple[str, str]] = {
    ast.Lt: ("<", "<="), ast.LtE: ("<=", "<"), ast.Gt: (">", ">="), ast.GtE: (">=", ">"), ast.Eq: ("==", "!="),
    ast.NotEq: ("!=", "=="), ast.Is: ("is", "is not"), ast.IsNot: ("is not", "is"), ast.In: ("in", "not in"),
    ast.NotIn: ("not in", "in"), ast.And: ("and", "or"), ast.Or: ("or", "and"), ast.Add: ("+", "-"),
    ast.Sub: ("-", "+"), ast.Mult: ("*", "/"), ast.Div: ("/", "*"), ast.FloorDiv: ("//", "*"), ast.Mod: ("%", "*"),
    ast.LShift: ("<<", ">>"), ast.RShift: (">>", "<<"), ast.BitAnd: ("&", "|"), ast.BitOr: ("|", "&"),
}  # fmt: skip
NAMES = {"any": "all", "all": "any", "min": "max", "max": "min"}


@dataclasses.dataclass(frozen=True)
class Mutant:
    """A wrong place: in ``path`` the lines ``new`` stand for the lines ``old``, which occur there once."""

    path: Path
    old: str
    new: str
    noticed: str = ""
    """What noticed it when the list was written."""

    @classmethod
    def at(cls, path: Path, text: bytes, begin: int, end: int, after: str) -> "Mutant":
        """``after`` for the bytes from ``begin`` to ``end``, with so many lines around that the place is unique."""
        first, last = text.rfind(b"\n", 0, begin) + 1, text.find(b"\n", end) % (len(text) + 1)
        while first and text.count(text[first:last]) > 1:
            first = text.rfind(b"\n", 0, max(first - 1, 0)) + 1
        return cls(path, text[first:last].decode(), (text[first:begin] + after.encode() + text[end:last]).decode())

    def find(self, files: Sequence[Path]) -> Path | None:
        """Where the lines are today: in their file, or in the one other that has them."""
        holding = [
            each
            for each in dict.fromkeys([self.path, *files])
            if (ROOT / each).exists() and (ROOT / each).read_text(encoding="utf-8").count(self.old) == 1
        ]
        return holding[0] if holding[:1] == [self.path] or len(holding) == 1 else None

    def apply(self, text: bytes) -> bytes:
        return text.replace(self.old.encode(), self.new.encode(), 1)

    def describe(self, text: bytes) -> str:
        lines = [each.splitlines() for each in (text.decode(), self.apply(text).decode())]
        line = next((i for i, (one, other) in enumerate(zip(*lines, strict=False)) if one != other), len(lines[1]) - 1)
        right, wrong = (each[line].strip()[:90] for each in lines)
        return f"{self.path}:{line + 1}: {right}  ->  {wrong}"


def find_mutants(path: Path, text: bytes) -> list[Mutant]:
    """List all places of a file that can be made wrong."""
    starts = [0]
    for line in text.splitlines(keepends=True):
        starts.append(starts[-1] + len(line))

    def place(node: ast.stmt | ast.expr) -> tuple[int, int]:
        end = starts[(node.end_lineno or 0) - 1] + (node.end_col_offset or 0)
        return starts[node.lineno - 1] + node.col_offset, end

    def replace(node: ast.stmt | ast.expr, after: str) -> Mutant:
        return Mutant.at(path, text, *place(node), after)

    def swap(left: ast.expr, operator: ast.AST, right: ast.expr) -> Mutant:
        """What stands between two operands, with another operator."""
        begin, end = place(left)[1], place(right)[0]
        return Mutant.at(path, text, begin, end, text[begin:end].decode().replace(*SWAPS[type(operator)], 1))

    def negate(node: ast.expr) -> Mutant:
        begin, end = place(node)
        return replace(node, f"(not ({text[begin:end].decode()}))")

    found = []
    for node in _walk(ast.parse(text)):
        match node:
            case ast.Compare(left=left, ops=[operator], comparators=[right]):
                found.append(swap(left, operator, right))
            case ast.BinOp(left=left, op=operator, right=right) if type(operator) in SWAPS:
                found.append(swap(left, operator, right))
            case ast.BoolOp(values=[left, right, *_], op=operator):
                found.append(swap(left, operator, right))
            case ast.UnaryOp(op=ast.Not()):
                found.append(negate(node))
            case ast.If(test=test) | ast.IfExp(test=test):
                found.append(negate(test))
            case ast.Constant(value=bool(value)):
                found.append(replace(node, str(not value)))
            case ast.Constant(value=int(value)):
                found.append(replace(node, str(value + 1)))
            case ast.Name(id=name, ctx=ast.Load()) if name in NAMES:
                found.append(replace(node, NAMES[name]))
            case ast.AugAssign() | ast.Expr(value=ast.Call()) | ast.Break():
                found.append(replace(node, "pass"))
    return found


def _walk(node: ast.AST) -> Iterator[ast.AST]:
    """All that computes: no annotations, no docstrings, no text of messages."""
    if isinstance(node, ast.Assert | ast.Raise | ast.JoinedStr | ast.Import | ast.ImportFrom):
        return
    yield node
    for name, value in ast.iter_fields(node):
        if name not in ("annotation", "returns", "decorator_list"):
            for child in value if isinstance(value, list) else [value]:
                if isinstance(child, ast.AST):
                    yield from _walk(child)


@cache
def _closures() -> dict[Path, set[str]]:
    """The modules that each file of tests imports, those that import least first."""
    files = [path.relative_to(ROOT) for path in sorted((ROOT / "tests").rglob("test_*.py"))]
    closures = {path: set(digest_each(".".join(path.with_suffix("").parts))) for path in files}
    # Commands are imported by their names.
    commands = digest_each(*(f"skymosaic.cli.{path.stem}" for path in (ROOT / "skymosaic" / "cli").glob("[!_]*.py")))
    for modules in closures.values():
        modules.update(commands if "skymosaic.cli" in modules else ())
    return dict(sorted(closures.items(), key=lambda each: len(each[1])))


def choose_tests(path: Path) -> list[Path]:
    """The file of tests beside a file of code, those of its folder, and some of the others that reach it."""
    module = ".".join(path.with_suffix("").parts)
    beside = Path("tests") / path.with_name(f"test_{path.name}")
    reaching = [each for each, modules in _closures().items() if module in modules]
    # Of its folder all: pages and commands are tested in another process, which imports do not show.
    near = [each for each in _closures() if each.parent == beside.parent]
    # First those that import it, as the file that small modules share.
    near.sort(key=lambda each: module not in (ROOT / each).read_text(encoding="utf-8"))
    chosen = dict.fromkeys([*([beside] if (ROOT / beside).exists() else []), *near])
    others = [each for each in reaching if each not in chosen]
    # First those that name it, as a command is named; the test of the catalogue's rows names none.
    others.sort(key=lambda each: each != ROWS and f'"{path.stem}' not in (ROOT / each).read_text(encoding="utf-8"))
    return [*chosen, *others[:MAX_REACHING]]


def notices(tree: Path, tests: Sequence[Path]) -> str:
    """What the tests say in a tree, the first of them by itself: the first that fails, "time", or nothing."""
    command = [sys.executable, "-m", "pytest", "-q", "-x", "-m", "not slow", "-p", "no:cacheprovider"]
    environment = {**os.environ, "PYTHONPATH": str(tree), "PYTHONDONTWRITEBYTECODE": "1"}
    run = partial(subprocess.run, cwd=tree, env=environment, capture_output=True, text=True, timeout=SECONDS)
    for some in filter(None, (tests[:1], tests[1:])):
        try:
            done = run([*command, *map(str, some)])
        except subprocess.TimeoutExpired:
            return "time"
        if done.returncode not in (0, 5):
            failed = [line for line in done.stdout.splitlines() if line.startswith(("FAILED", "ERROR"))]
            return failed[0][:150] if failed else f"status {done.returncode}"
    return ""


def _list_files(given: Sequence[Path], since: str) -> list[Path]:
    command = ["git", "diff", "--name-only", since] if since else ["git", "ls-files"]
    listed = subprocess.check_output([*command, "--", *map(str, given or PACKAGES)], cwd=ROOT, text=True).splitlines()
    return [
        Path(line) for line in listed if re.match(rf"({'|'.join(PACKAGES)})/.*\.py$", line) and (ROOT / line).exists()
    ]


def _try(tree: Path, mutant: Mutant) -> Mutant:
    """The mutant with what notices it in a copy of the tree; first the tests that did before: most need no others."""
    text, before = (ROOT / mutant.path).read_bytes(), re.match(r"(?:FAILED|ERROR) (\S+?\.py)", mutant.noticed)
    (tree / mutant.path).write_bytes(mutant.apply(text))
    said = notices(tree, [Path(before[1])]) if before and (ROOT / before[1]).exists() else ""
    said = said or notices(tree, choose_tests(mutant.path))
    (tree / mutant.path).write_bytes(text)
    return dataclasses.replace(mutant, noticed=said)


def _sample(given: argparse.Namespace, files: Sequence[Path]) -> list[Mutant]:
    """The places of a list, wherever they are today, or a sample of all."""
    if given.list and given.list.exists():
        listed = [Mutant(Path(path), *texts) for path, *texts in json.loads(given.list.read_text(encoding="utf-8"))]
        found = [(each, each.find(files)) for each in listed]
        print(*(f"gone: {each.path}: {each.old.strip()}" for each, path in found if path is None), sep="\n", flush=True)
        return [dataclasses.replace(each, path=path) for each, path in found if path]
    seed = given.seed if given.seed is not None else random.SystemRandom().randrange(1000)
    places = [each for path in files for each in find_mutants(path, (ROOT / path).read_bytes())]
    sample = random.Random(seed).sample(places, min(given.count, len(places)))
    print(f"seed {seed}: {len(sample)} of {len(places)} places", flush=True)
    return sample


def main() -> None:
    """Sample or read, run and list; the survivors come last."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("paths", nargs="*", type=Path, help="files or folders; by default all packages")
    parser.add_argument("--count", type=int, default=40, help="mutants")
    parser.add_argument("--seed", type=int, default=None, help="by default another one each time, which is printed")
    parser.add_argument("--since", default="", help="only files that have changed since this commit")
    parser.add_argument("--list", type=Path, help="file of places: replayed where it exists, written otherwise")
    given = parser.parse_args()
    sample = _sample(given, _list_files(given.paths, given.since))
    tried = []
    with tempfile.TemporaryDirectory() as folder:
        tree = Path(folder) / "tree"
        shutil.copytree(ROOT, tree, ignore=shutil.ignore_patterns(".venv", ".git", "__pycache__", "build", "dist"))
        for mutant in sample:
            start = time.monotonic()
            tried.append(_try(tree, mutant))
            said, seconds = tried[-1].noticed or "NOT NOTICED", time.monotonic() - start
            print(f"{mutant.describe((ROOT / mutant.path).read_bytes())}: {said} ({seconds:.0f} s)", flush=True)
    if given.list and not given.list.exists():
        rows = [(str(each.path), each.old, each.new, each.noticed) for each in tried]
        given.list.write_text(json.dumps(rows, indent=1), encoding="utf-8")
    survivors = [each.describe((ROOT / each.path).read_bytes()) for each in tried if not each.noticed]
    print(f"{len(tried) - len(survivors)} of {len(tried)} noticed; not:", *survivors, sep="\n")


if __name__ == "__main__":
    main()
