"""A zero-order Sugeno system in real numbers."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from golden_model.arrays import Array
from golden_model.fuzzy.sugeno import count_largest
from golden_model.fuzzy.terms import Term

CONJUNCTIONS = ("minimum", "product")


@dataclass(frozen=True)
class Input:
    """An input with its range and its fuzzy sets by name; ``line`` is that of its text, 0 for none."""

    name: str
    low: float
    high: float
    terms: Mapping[str, Term]
    line: int = field(default=0, compare=False)


@dataclass(frozen=True)
class Output:
    """The output with its range and its constants by name; ``default`` is its value where no rule fires."""

    name: str
    low: float
    high: float
    constants: Mapping[str, float]
    default: float = math.nan
    line: int = field(default=0, compare=False)


@dataclass(frozen=True)
class IfThen:
    """The rule ``if INPUT is TERM and ... then OUTPUT is CONSTANT``; an input without a condition may be anything.

    A rule that ``joins`` the one before is its alternative (OR): only the largest strength of them counts.
    """

    conditions: Mapping[str, str]
    conclusion: str
    joins: bool = False
    line: int = field(default=0, compare=False)


@dataclass(frozen=True)
class FuzzySystem:
    """A zero-order Sugeno system with one output: the mean of the rules' constants, weighted by their strengths.

    Raises
    ------
    ValueError
        For a range that is empty, a rule that names what does not exist, or no rules.
    """

    name: str
    inputs: tuple[Input, ...]
    output: Output
    rules: tuple[IfThen, ...]
    conjunction: str
    """The operation for AND, one of `CONJUNCTIONS`."""
    description: str = field(default="", compare=False)

    def __post_init__(self) -> None:
        if self.conjunction not in CONJUNCTIONS:
            raise ValueError(f"AND is {self.conjunction}; valid: {', '.join(CONJUNCTIONS)}")
        if not self.inputs or not self.rules:
            raise ValueError("a system needs at least one input and one rule")
        variables: list[Input | Output] = [*self.inputs, self.output]
        for variable in variables:
            if not (math.isfinite(variable.low) and math.isfinite(variable.high) and variable.low < variable.high):
                raise ValueError(
                    f"{_place(variable)}{variable.name}: range is {variable.low} to {variable.high}; give two finite "
                    "numbers"
                )
        for number, rule in enumerate(self.rules, start=1):
            self._check_rule(rule, f"{_place(rule)}rule {number}")

    def _check_rule(self, rule: IfThen, where: str) -> None:
        terms = {each.name: each.terms for each in self.inputs}
        for name, chosen in rule.conditions.items():
            if name not in terms:
                raise ValueError(f"{where}: no input {name}; there are {', '.join(terms)}")
            if chosen not in terms[name]:
                raise ValueError(f"{where}: {name} has no term {chosen}; it has {', '.join(terms[name])}")
        if not rule.conditions:
            raise ValueError(f"{where} has no condition")
        if rule.conclusion not in self.output.constants:
            known = ", ".join(self.output.constants)
            raise ValueError(f"{where}: {self.output.name} has no constant {rule.conclusion}; it has {known}")

    def strengths(self, *values: Array) -> Array:
        """Compute the firing strength of each rule, (N, rules), for (N,) values of each input."""
        degrees = {
            variable.name: {name: term.degree(value) for name, term in variable.terms.items()}
            for variable, value in zip(self.inputs, values, strict=True)
        }
        combine = np.minimum.reduce if self.conjunction == "minimum" else np.multiply.reduce
        rules = [[degrees[name][chosen] for name, chosen in rule.conditions.items()] for rule in self.rules]
        return np.stack([combine(np.stack(parts), axis=0) for parts in rules], axis=1)

    def evaluate(self, *values: Array) -> Array:
        """Compute the output, (N,), for (N,) values of each input; the default where no rule fires."""
        strengths = count_largest(self.strengths(*values), [rule.joins for rule in self.rules])
        total = strengths.sum(axis=1)
        constants = np.array([self.output.constants[rule.conclusion] for rule in self.rules])
        with np.errstate(invalid="ignore"):
            return np.asarray(np.where(total > 0, strengths @ constants / total, self.output.default))


def _place(part: Input | Output | IfThen) -> str:
    return f"line {part.line}: " if part.line else ""
