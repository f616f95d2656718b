"""Rules that decide matches, in FLL: what their inputs mean, and their tables for a length of the descriptor."""

import math
import re
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path

import numpy as np

from golden_model.arrays import Array
from golden_model.fuzzy.fll import read_file, read_fll
from golden_model.fuzzy.sugeno import SugenoSystem
from golden_model.fuzzy.system import FuzzySystem, Input, Output, make_tables

SHIPPED = Path(__file__).parent / "systems"
"""Folder of the project's own systems."""
QUANTITIES = {
    "distance": (1, 0), "margin": (1, 0), "orientation": (8, 1), "SAD_r1": (20, 9), "SAD_r2": (20, 9),
    "SAD": (20, 16), "ZSSD": (60, 4), "NCC": (1, 256),
}  # fmt: skip
"""What an input of that name can be: its upper end, the lower is 0, and table entries per unit; 0: the descriptor's
bits. Distance and margin are shares of the bits, an orientation counts sixteenths of a circle from the most common one,
SAD and ZSSD are in gray levels per pixel."""
INPUTS = (("distance", "margin", "orientation"), ("distance", "SAD_r1", "SAD_r2"))
"""The inputs of rules that decide matches: of any ILBP descriptor, and of one that carries its window."""
FINEST_BITS = 256
"""The tables for most shorter descriptors are every other, every fourth, ... entry of these."""
_IDENTIFIER = re.compile(r"[A-Za-z_][A-Za-z0-9_$]*")


@dataclass(frozen=True)
class MatchRules:
    """Rules that give each match its weight.

    Raises
    ------
    ValueError
        For text that `read_fll` refuses, other inputs or ranges, and names that are no Verilog identifiers; the message
        is one line that names the line of the text.
    """

    text: str
    """FLL with the inputs of `INPUTS`, ranges as in `QUANTITIES`, and one output from 0 to 1."""
    source: str = field(default="rules", compare=False, repr=False)
    """Where the text is from; messages begin with it."""

    def __post_init__(self) -> None:
        try:
            _check_system(self.system)
            _check_names(self.text)
            match_tables(self.text, FINEST_BITS)
        except ValueError as error:
            raise ValueError(f"{self.source}: {error}") from None

    @property
    def system(self) -> FuzzySystem:
        """The rules in real numbers."""
        return _read(self.text)

    @property
    def name(self) -> str:
        """The name in the text, or of its file."""
        return self.system.name or Path(self.source).stem

    @property
    def compares_windows(self) -> bool:
        """Whether the rules need the gray windows around the features."""
        return "SAD_r1" in (each.name for each in self.system.inputs)

    def tables(self, bits: int) -> SugenoSystem:
        """The integer model, from which golden model and hardware are made, for descriptors of ``bits``.

        Raises
        ------
        ValueError
            For inputs that no term or no rule covers, unless the output has the default 0, and for what `make_tables`
            refuses.
        """
        try:
            return match_tables(self.text, bits)
        except ValueError as error:
            raise ValueError(f"{self.source}: {error}") from None


def load_rules(path: str | Path) -> MatchRules:
    """Read rules from an ``.fll`` or ``.fis`` file.

    Raises
    ------
    ValueError
        For a file that cannot be read, and as `MatchRules` says.
    """
    return MatchRules(read_file(Path(path)), str(path))


@lru_cache
def shipped_rules(name: str) -> MatchRules:
    """The project's own rules of that name."""
    return MatchRules(read_shipped(name), name)


@lru_cache
def read_shipped(name: str) -> str:
    """The text of the project's own system of that name."""
    return read_file(SHIPPED / f"{name}.fll")


@lru_cache
def match_tables(text: str, bits: int) -> SugenoSystem:
    """Make the tables of a system whose inputs are `QUANTITIES`; an input beyond a table's end reads the last entry.

    Raises
    ------
    ValueError
        See `MatchRules.tables`.
    """
    system = _read(text)
    try:
        tables = make_tables(system, [_positions(each, bits) for each in system.inputs], trimmed=True)
    except ValueError as error:
        raise ValueError(f"line {system.rules[0].line}: {error}") from None
    if math.isnan(system.output.default):
        _check_coverage(system, tables, bits)
    return tables


@lru_cache
def _read(text: str) -> FuzzySystem:
    return read_fll(text)


def _positions(variable: Input, bits: int) -> Array:
    high, per_unit = QUANTITIES[variable.name]
    return np.arange(high * (per_unit or bits) + 1) / (per_unit or bits)


def _check_system(system: FuzzySystem) -> None:
    names = tuple(each.name for each in system.inputs)
    if names not in INPUTS:
        known = " or ".join(", ".join(inputs) for inputs in INPUTS)
        last = system.inputs[-1]
        raise ValueError(f"line {last.line}: the inputs are {', '.join(names)}; those of a match are {known}")
    ranged: list[tuple[Input | Output, int]] = [(each, QUANTITIES[each.name][0]) for each in system.inputs]
    for each, high in [*ranged, (system.output, 1)]:
        if (each.low, each.high) != (0, high):
            raise ValueError(
                f"line {each.line}: the range of {each.name} is {each.low:g} to {each.high:g}; it must be 0 to {high}"
            )
    if not math.isnan(system.output.default) and system.output.default != 0:
        raise ValueError(
            f"line {system.output.line}: the default is {system.output.default:g}; where no rule fires, the weight is 0"
        )


def _check_names(text: str) -> None:
    for line, row in enumerate(text.splitlines(), start=1):
        key, _, value = (part.strip() for part in row.partition("#")[0].partition(":"))
        name = value.split()[0] if value else ""
        if key in ("InputVariable", "OutputVariable", "term") and not _IDENTIFIER.fullmatch(name):
            raise ValueError(f"line {line}: {name!r} is no Verilog identifier; use letters, digits and underscores")


def _check_coverage(system: FuzzySystem, tables: SugenoSystem, bits: int) -> None:
    """Find inputs that no term covers, then combinations for which no rule fires."""
    chosen = []
    for each, variable in zip(system.inputs, tables.inputs, strict=True):
        positions = _positions(each, bits)
        covered = (np.stack(list(variable.sets.values())) > 0)[
            :, np.minimum(np.arange(len(positions)), variable.entries - 1)
        ]
        gaps = np.flatnonzero(~covered.any(axis=0))
        if gaps.size:
            run = positions[gaps[gaps - np.arange(gaps.size) == gaps[0]]]
            span = f"{run[0]:.4g} to {run[-1]:.4g}"
            raise ValueError(f"line {each.line}: no term of {each.name} covers {span}; add one, or the default 0")
        # Values with the same terms above 0 make the same rules fire.
        chosen.append(np.unique(covered, axis=1, return_index=True)[1])
    grid = [axis.ravel() for axis in np.meshgrid(*chosen, indexing="ij")]
    silent = np.flatnonzero(~tables.strengths(*grid).any(axis=1))
    if silent.size:
        values = zip(system.inputs, grid, strict=True)
        where = ", ".join(f"{each.name} {_positions(each, bits)[axis[silent[0]]]:.4g}" for each, axis in values)
        raise ValueError(f"line {system.rules[-1].line}: no rule fires at {where}; add one, or the default 0")
