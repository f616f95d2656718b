"""The largest rules that decide matches."""

import numpy as np

from golden_model.fuzzy.fll import MAX_PARAMETERS, MAX_TERMS
from golden_model.fuzzy.rules import INPUTS, QUANTITIES, MatchRules
from golden_model.fuzzy.sugeno import MAX_RULES


def largest_rules() -> MatchRules:
    """16 terms for each input without a pattern from which synthesis could gain, and 32 rules that name all of them.

    AND is the minimum, which ends in a division; combinations that no rule names are rejected.
    """
    rng = np.random.default_rng(1)
    lines, chosen = ["Engine: largest"], []
    for name in INPUTS[0]:
        high = QUANTITIES[name][0]
        lines += [f"InputVariable: {name}", f"  range: 0 {high}"]
        points = np.linspace(0, high, MAX_PARAMETERS // 2)
        for n, degrees in enumerate(rng.random((MAX_TERMS, len(points)))):
            parameters = " ".join(f"{x} {y}" for x, y in zip(points, degrees, strict=True))
            lines.append(f"  term: t{n} Discrete {parameters}")
        chosen.append(rng.permutation(np.arange(MAX_RULES) % MAX_TERMS))
    lines += ["OutputVariable: weight", "  range: 0 1", "  defuzzifier: WeightedAverage", "  default: 0"]
    lines += [f"  term: c{n} Constant {n / (MAX_RULES - 1)}" for n in range(MAX_RULES)]
    lines += ["RuleBlock: rules", "  conjunction: Minimum"]
    for n, terms in enumerate(zip(*chosen, strict=True)):
        conditions = " and ".join(f"{name} is t{term}" for name, term in zip(INPUTS[0], terms, strict=True))
        # Scattered, so that neighbouring rules decide differently.
        lines.append(f"  rule: if {conditions} then weight is c{7 * n % MAX_RULES}")
    return MatchRules("\n".join(lines) + "\n", "largest")
