"""Digests of code, for keys of caches: what other code computed is not found again."""

import functools
import hashlib
from collections.abc import Set
from pathlib import Path
from types import CodeType

ROOT = Path(__file__).parents[1]
PACKAGES = ("golden_model", "hdl", "sim", "skymosaic", "tests")
DATA = (".cpp", ".fll", ".hpp", ".v")
"""Endings of the files that the code computes from: harnesses of simulators, fuzzy systems, models of cells."""


@functools.cache
def digest_code(*modules: str) -> str:
    """A digest of modules, of all of this project that they import, and of the data in their packages.

    The whole text counts. Messages do because some are results: what the decoder says about a damaged photograph is
    kept with its features. Comments do because few commits change nothing else. Versions that are raised by hand would
    need a test that notices every change of a result, and without it a stale entry is a wrong answer that looks right.

    Parameters
    ----------
    *modules : str
        Names as they are imported. What one of them imports by a computed name is not seen: name it, too. A package
        counts where it is imported itself; what its modules compute does not depend on it.

    Raises
    ------
    KeyError
        For a module that does not exist.
    """
    digests = digest_each(*modules)
    packages = sorted({module.partition(".")[0] for module in digests})
    data = [path for package in packages for path in sorted((ROOT / package).rglob("*")) if path.suffix in DATA]
    parts = sorted(digests.items()), [(path.name, path.read_bytes()) for path in data]
    return hashlib.sha256(repr(parts).encode()).hexdigest()


def digest_each(*modules: str) -> dict[str, str]:
    """The digest of the text of each module, and of all of this project that they import, by name."""
    digests: dict[str, str] = {}
    waiting = {*modules}
    while waiting:
        module = waiting.pop()
        digests[module], imported = _read(module)
        waiting |= imported - digests.keys()
    return digests


@functools.cache
def _modules() -> dict[str, Path]:
    """The modules and packages of this project, by the names with which they are imported."""
    paths = [path for package in PACKAGES for path in (ROOT / package).rglob("*.py")]
    return {".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__"): path for path in paths}


@functools.cache
def _read(module: str) -> tuple[str, Set[str]]:
    """The digest of a module's text, and what it imports of this project: perhaps a few more, never fewer."""
    text, known = _modules()[module].read_bytes(), _modules()
    names = _names(compile(text, module, "exec", dont_inherit=True))
    # For ``from package import module``. What follows the name of a module is no module.
    names |= {f"{one}.{name}" for one in names & known.keys() if known[one].stem == "__init__" for name in names}
    return hashlib.sha256(text).hexdigest(), names & known.keys()


def _names(code: CodeType) -> set[str]:
    """The names that code uses, those of imported modules among them, also inside functions."""
    return set(code.co_names).union(*(_names(each) for each in code.co_consts if isinstance(each, CodeType)))
