"""The largest rules that decide matches: 16 terms for each input, and 32 rules that name every one of them."""

import itertools
from collections.abc import Iterable, Sequence

import numpy as np

from golden_model.fuzzy.fll import MAX_PARAMETERS, MAX_TERMS
from golden_model.fuzzy.rules import INPUTS, QUANTITIES, MatchRules
from golden_model.matching.fuzzy import MAX_RULES


def largest_minimum() -> MatchRules:
    """Rules joined by the minimum, which ends in a division; combinations that no rule names are rejected."""
    rng = np.random.default_rng(1)
    per_term = MAX_RULES // MAX_TERMS
    columns = [rng.permutation(np.repeat(np.arange(MAX_TERMS), per_term)).tolist() for _ in INPUTS[0]]
    return _write("Minimum", (MAX_TERMS,) * 3, zip(*columns, strict=True))


def largest_product() -> MatchRules:
    """Rules joined by the product: 4 x 4 x 2 terms, since every combination needs its rule."""
    sizes = (4, 4, 2)
    return _write("AlgebraicProduct", sizes, itertools.product(*map(range, sizes)))


def _write(conjunction: str, sizes: Sequence[int], rules: Iterable[Sequence[int]]) -> MatchRules:
    name, rng = f"largest_{conjunction.lower()}", np.random.default_rng(2)
    lines = [f"Engine: {name}"]
    for variable, count in zip(INPUTS[0], sizes, strict=True):
        high = QUANTITIES[variable][0]
        lines += [f"InputVariable: {variable}", f"  range: 0 {high}"]
        points = np.linspace(0, high, MAX_PARAMETERS // 2)
        # Degrees without a pattern, from which synthesis could gain. Those of a product have to sum to one.
        degrees = rng.random((count, len(points)))
        degrees /= degrees.sum(axis=0) if conjunction == "AlgebraicProduct" else 1
        for n, row in enumerate(degrees):
            lines.append(f"  term: t{n} Discrete " + " ".join(f"{x} {y}" for x, y in zip(points, row, strict=True)))
    lines += ["OutputVariable: weight", "  range: 0 1", "  defuzzifier: WeightedAverage", "  default: 0"]
    lines += [f"  term: c{n} Constant {n / (MAX_RULES - 1)}" for n in range(MAX_RULES)]
    lines += ["RuleBlock: rules", f"  conjunction: {conjunction}"]
    for n, terms in enumerate(rules):
        conditions = " and ".join(f"{variable} is t{term}" for variable, term in zip(INPUTS[0], terms, strict=True))
        # Scattered, so that neighbouring rules decide differently.
        lines.append(f"  rule: if {conditions} then weight is c{7 * n % MAX_RULES}")
    return MatchRules("\n".join(lines) + "\n", name)
