"""Turns a fuzzy system in real numbers into the tables and rules of the integer model."""

from collections.abc import Sequence

import numpy as np

from golden_model.arrays import Array
from golden_model.fuzzy.sugeno import ONE, Rule, SugenoSystem, Table, Variable
from golden_model.fuzzy.system import FuzzySystem, Input


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
