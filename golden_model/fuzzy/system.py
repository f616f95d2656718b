"""A zero-order Sugeno system in real numbers, and the tables and rules of its integer model."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from golden_model.arrays import Array
from golden_model.fuzzy.sugeno import ONE, Rule, SugenoSystem, Table, Variable, count_largest
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


def make_tables(system: FuzzySystem, positions: Sequence[Array], *, trimmed: bool = False) -> SugenoSystem:
    """Sample the terms of each input at its ``positions``, one per table entry, and scale the constants.

    ``trimmed`` leaves out entries at a table's end that equal the one before: larger inputs read the last entry. The
    output is 0 at the low end of its range and 256 (saturated to 255) at the high end; 0 where no rule fires.

    Raises
    ------
    ValueError
        For more than 32 rules, or AND as product with terms whose strengths do not sum to one: the model does not
        divide there.
    """
    output = system.output
    return SugenoSystem(
        system.name,
        inputs=tuple(
            Variable(variable.name, _sample_terms(variable, entries, trimmed=trimmed))
            for variable, entries in zip(system.inputs, positions, strict=True)
        ),
        rules=tuple(
            Rule(
                tuple(rule.conditions.get(variable.name) for variable in system.inputs),
                (output.constants[rule.conclusion] - output.low) / (output.high - output.low),
                rule.joins,
            )
            for rule in system.rules
        ),
        # A single input has nothing to multiply: without a product, its terms need not sum to one.
        conjunction=system.conjunction if len(system.inputs) > 1 else "minimum",
    )


def _sample_terms(variable: Input, positions: Array, *, trimmed: bool) -> dict[str, Table]:
    degrees = np.stack([term.degree(positions) for term in variable.terms.values()])
    if np.allclose(degrees.sum(axis=0), 1.0, atol=1e-9):
        # A product is not divided by the sum of the strengths, so terms that sum to one must do so in integers, too:
        # the sums so far are rounded, and each term gets what it adds to them.
        sums = _round(np.cumsum(degrees, axis=0))
        tables = np.diff(sums, axis=0, prepend=0)
    else:
        tables = _round(degrees)
    if trimmed:
        changes = np.flatnonzero((tables != tables[:, -1:]).any(axis=0))
        tables = tables[:, : changes.max(initial=-1) + 2]
    return dict(zip(variable.terms, tables, strict=True))


def _round(degrees: Array) -> Table:
    # Halves are rounded up everywhere in the golden model; NumPy would round them to even.
    return np.floor(degrees * ONE + 0.5).astype(np.int64)
