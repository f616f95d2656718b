"""Zero-order Sugeno systems in fixed point: membership tables, and rules with singletons.

Degrees of membership and singletons are UQ1.8 (`golden_model.formats.MEMBERSHIP`). Inputs are unsigned integers that
index the tables; an input beyond the last entry reads the last entry. Evaluation is exact in integers up to one final
rounding, so that hardware may form the products in any order. The systems of the matcher are in
`golden_model.matching.rule_bases`.
"""

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from golden_model.formats import MEMBERSHIP, WEIGHT, round_shift

ONE = MEMBERSHIP.one
MAX_RULES = 32
"""The rule field of a match record has 5 bits."""

Table = NDArray[np.int64]
Number = TypeVar("Number", np.int64, np.float64)


@dataclass(frozen=True)
class Variable:
    """An input: its name and its fuzzy sets; the membership tables of the sets have the same length.

    Raises
    ------
    ValueError
        If there is no set, lengths differ, or a degree is outside 0..256.
    """

    name: str
    sets: Mapping[str, Table]

    def __post_init__(self) -> None:
        if len({len(table) for table in self.sets.values()}) != 1:
            raise ValueError(f"{self.name}: needs one or more sets, with tables of one length")
        for name, table in self.sets.items():
            if len(table) == 0 or table.min() < 0 or table.max() > ONE:
                raise ValueError(f"{self.name} {name}: a table holds at least one degree, each 0 to {ONE}")

    @property
    def entries(self) -> int:
        """Length of the tables."""
        return len(next(iter(self.sets.values())))


@dataclass(frozen=True)
class Rule:
    """``IF input 0 is sets[0] AND input 1 is sets[1] … THEN output``.

    ``None`` instead of a set ignores that input. ``output`` is a real number in 0..1, rounded to UQ1.8. Rules that
    ``joins`` the one before are its alternatives (OR), with the same output: the largest of their strengths counts.
    """

    sets: tuple[str | None, ...]
    output: float
    joins: bool = False

    @property
    def singleton(self) -> int:
        """The output as UQ1.8."""
        return MEMBERSHIP.quantise(self.output)


class SugenoSystem:
    """A set of rules; the result is the mean of their singletons, weighted by the strengths of the rules.

    Parameters
    ----------
    name : str
        Used in messages.
    inputs : tuple of Variable
        In the order of the arguments of `evaluate`.
    rules : tuple of Rule
        At most 32.
    conjunction : {"product", "minimum"}
        The operation for AND. Product: the strengths must sum to one for every input, so that no division is needed;
        the constructor checks all inputs. Minimum: the result is divided by the sum of the strengths.

    Attributes
    ----------
    strength_one : int
        The strength that represents 1: 256 ** inputs with the product, 256 with the minimum.

    Raises
    ------
    ValueError
        For a wrong number of rules, alternatives that cannot be, or a product system whose strengths do not sum to one.
        That sets exist, and outputs are in their range, is checked where systems are read
        (`golden_model.fuzzy.system.FuzzySystem`).
    """

    def __init__(self, name: str, *, inputs: tuple[Variable, ...], rules: tuple[Rule, ...], conjunction: str) -> None:
        if not 1 <= len(rules) <= MAX_RULES:
            raise ValueError(f"{name}: has {len(rules)} rules; it must have 1 to {MAX_RULES}")
        self.name = name
        self.inputs = inputs
        self.rules = rules
        self.conjunction = conjunction
        self.strength_one = ONE ** len(inputs) if conjunction == "product" else ONE
        for index, rule in enumerate(rules):
            # The first rule follows none.
            if rule.joins and (conjunction == "product" or index == 0 or rules[index - 1].output != rule.output):
                raise ValueError(
                    f"{name}, rule {index}: OR needs conjunction 'minimum', and a rule before it with the same output"
                )
        self._singletons = np.array([rule.singleton for rule in rules], dtype=np.int64)
        if conjunction == "product":
            self._check_sum()

    def _check_sum(self) -> None:
        # Inputs with the same degree in every set give the same strengths: trying one of each group is enough.
        distinct = [
            np.unique(np.stack(list(variable.sets.values())), axis=1, return_index=True)[1] for variable in self.inputs
        ]
        # In floating point, whose products are fast, and here exact: sums of strengths are below 2**53.
        strengths = np.ones((1, len(self.rules)))
        for number, (variable, entries) in enumerate(zip(self.inputs, distinct, strict=True)):
            chosen = [
                np.full(variable.entries, ONE) if (name := rule.sets[number]) is None else variable.sets[name]
                for rule in self.rules
            ]
            degrees = np.stack(chosen, axis=1)[entries]
            if number < len(self.inputs) - 1:
                strengths = (strengths[:, np.newaxis] * degrees).reshape(-1, len(self.rules))
        total = (strengths @ degrees.T).ravel()
        wrong = np.flatnonzero(total != self.strength_one)
        if wrong.size:
            at = np.unravel_index(wrong[0], [len(entries) for entries in distinct])
            values = [entries[index] for entries, index in zip(distinct, at, strict=True)]
            where = ", ".join(f"{v.name} {value}" for v, value in zip(self.inputs, values, strict=True))
            raise ValueError(
                f"{self.name}: strengths sum to {total[wrong[0]] / self.strength_one:.4f} at {where}; make the sets "
                "complementary and the rules cover each combination once, or use conjunction 'minimum'"
            )

    @cached_property
    def digest(self) -> int:
        """32 bits that differ (but by chance) between systems that decide differently; names of sets do not count."""
        tables = [(each.name, [table.tolist() for table in each.sets.values()]) for each in self.inputs]
        order = [list(each.sets) for each in self.inputs]
        rules = [
            ([name and names.index(name) for names, name in zip(order, rule.sets, strict=True)], rule.singleton)
            for rule in self.rules
        ]
        alternatives = [number for number, rule in enumerate(self.rules) if rule.joins]
        described = json.dumps([self.conjunction, tables, rules, *([alternatives] if alternatives else [])]).encode()
        return int.from_bytes(hashlib.sha256(described).digest()[:4], "big")

    def strengths(self, *values: NDArray[np.integer]) -> NDArray[np.int64]:
        """Strength of every rule for (N,) values of each input: (N, rules) int64 in units of 1 / ``strength_one``.

        Raises
        ------
        ValueError
            If the number of inputs is wrong or a value is negative.
        """
        if len(values) != len(self.inputs):
            raise ValueError(f"{self.name}: takes {len(self.inputs)} inputs, not {len(values)}")
        degrees = [_look_up(variable, value) for variable, value in zip(self.inputs, values, strict=True)]
        columns = []
        for rule in self.rules:
            operands = [
                np.full(len(values[0]), ONE) if name is None else degree[name]
                for name, degree in zip(rule.sets, degrees, strict=True)
            ]
            columns.append(np.prod(operands, axis=0) if self.conjunction == "product" else np.min(operands, axis=0))
        return np.stack(columns, axis=1)

    def evaluate(self, *values: NDArray[np.integer]) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
        """Weight and dominant rule of N inputs.

        Parameters
        ----------
        *values : (N,) unsigned integers
            One array per input.

        Returns
        -------
        weight : (N,) uint8
            UQ0.8, rounded half up; 1 saturates to 255; 0 where no rule fires.
        dominant : (N,) uint8
            Index of the strongest rule, ties to the lowest.
        """
        strengths = self.strengths(*values)
        counted = count_largest(strengths, [rule.joins for rule in self.rules])
        total = counted @ self._singletons
        # The strengths of a product system sum to one: a shift replaces the division.
        if self.conjunction == "product":
            weight = round_shift(total, self.strength_one.bit_length() - 1)
        else:
            # At least 1, so that inputs for which no rule fires get weight 0.
            divisor = np.maximum(counted.sum(axis=1), 1)
            # total / divisor, rounded half up.
            weight = (2 * total + divisor) // (2 * divisor)
        # `argmax` takes the first of equal ones, so ties go to the lowest rule.
        dominant = strengths.argmax(axis=1)
        return np.minimum(weight, WEIGHT.max_raw).astype(np.uint8), dominant.astype(np.uint8)


def count_largest(strengths: NDArray[Number], joins: Sequence[bool]) -> NDArray[Number]:
    """What each rule's strength, (N, rules), exceeds those of the rules that it joins by: they sum to the largest."""
    counted = strengths.copy()
    for number, joined in enumerate(joins):
        if joined:
            # What was counted so far of the alternatives is their largest.
            first = max(n for n in range(number) if not joins[n])
            largest = counted[:, first:number].sum(axis=1)
            counted[:, number] = np.maximum(strengths[:, number] - largest, 0)
    return counted


def _look_up(variable: Variable, value: NDArray[np.integer]) -> dict[str, Table]:
    if value.size and value.min() < 0:
        raise ValueError(f"{variable.name}: value {value.min()} is negative; inputs are unsigned")
    index = np.minimum(value, variable.entries - 1)
    return {name: table[index] for name, table in variable.sets.items()}
