"""Results of the experiments: one line for each table, setting and pair."""

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from skymosaic.common.tables import to_csv

Line = tuple[str, str, Mapping[str, float]]
"""Table, setting and values, as an experiment yields them for one pair."""


@dataclass(frozen=True)
class Measurement:
    """Values of one setting (a row of a table) on one pair; values that could not be measured are left out."""

    table: str
    setting: str
    pair: str
    group: str
    values: Mapping[str, float]


@dataclass(frozen=True)
class Measurements:
    """All measurements, in the order they were made."""

    lines: Sequence[Measurement]

    def settings(self, table: str) -> list[str]:
        """The settings of a table, in order."""
        return list(dict.fromkeys(line.setting for line in self.lines if line.table == table))

    def values(self, table: str, setting: str, column: str) -> list[float]:
        """The values of one column, for all pairs on which it was measured."""
        return [
            line.values[column]
            for line in self.lines
            if line.table == table and line.setting == setting and column in line.values
        ]

    def number(self, table: str, setting: str, key: str) -> float:
        """Mean of a quantity, or of a sum or difference of several ("matches-good"); NaN if there is none.

        Two of them with " / " between are totals over all pairs, one divided by the other; NaN if that is 0.
        """
        part, _, whole = key.partition(" / ")
        if not whole:
            return self._sum(table, setting, key, np.mean)
        total = self._sum(table, setting, whole, np.sum)
        return self._sum(table, setting, part, np.sum) / total if total else float("nan")

    def _sum(self, table: str, setting: str, key: str, over_pairs: Callable[[list[float]], np.floating]) -> float:
        terms = re.findall("([-+]?)([^-+]+)", key)
        values = [(sign, self.values(table, setting, quantity)) for sign, quantity in terms]
        return sum(float(f"{sign}1") * float(over_pairs(found or [np.nan])) for sign, found in values)

    @property
    def groups(self) -> dict[str, "Measurements"]:
        """The measurements of each group of pairs, in order."""
        names = dict.fromkeys(line.group for line in self.lines)
        return {name: Measurements([line for line in self.lines if line.group == name]) for name in names}

    @property
    def pairs(self) -> list[str]:
        """The pairs, in order."""
        return list(dict.fromkeys(line.pair for line in self.lines))

    def to_csv(self) -> str:
        """Write every value as CSV with the columns table, setting, pair, group, quantity, value."""
        rows = (
            (line.table, line.setting, line.pair, line.group, quantity, value)
            for line in self.lines
            for quantity, value in line.values.items()
        )
        return to_csv(("table", "setting", "pair", "group", "quantity", "value"), rows)
