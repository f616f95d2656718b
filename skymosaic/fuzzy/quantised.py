"""The integer model of a fuzzy system, and how far it is from the real numbers."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from golden_model.arrays import Array
from golden_model.formats import WEIGHT
from golden_model.fuzzy.sugeno import SugenoSystem
from golden_model.fuzzy.system import FuzzySystem, Input, make_tables

ENTRIES = 64
"""Default number of entries per table."""
MAX_CHECKED = 1 << 18
"""Inputs that are compared; if the tables have more combinations, this many are drawn at random."""
MAX_COMBINATIONS = 1 << 21
"""Combinations of table entries for which the model checks that a product needs no division."""
MIN_FIRING_STRENGTH = 0.25
"""Rules fire firmly if their strengths sum to at least this."""


@dataclass(frozen=True)
class QuantisedSystem:
    """A fuzzy system whose inputs index tables, as `golden_model.fuzzy.sugeno` computes it."""

    real: FuzzySystem
    model: SugenoSystem
    """Each input is an index: 0 at the low end of its range, ``entries - 1`` at the high end. The output is 0 at the
    low end of its range and 256 (saturated to 255) at the high end; 0 where no rule fires."""
    entries: int
    """Entries per table."""

    def positions(self, variable: Input) -> Array:
        """Values of an input at all indices, in its own unit."""
        return np.linspace(variable.low, variable.high, self.entries)

    def evaluate(self, *indices: NDArray[np.integer]) -> Array:
        """Compute the output in its own unit for (N,) indices of each input."""
        output = self.real.output
        raw = self.model.evaluate(*indices)[0]
        return np.asarray(output.low + (output.high - output.low) * raw / WEIGHT.one)


@dataclass(frozen=True)
class ErrorBounds:
    """Difference between integer model and real numbers, as share of the output's range."""

    largest: float
    mean: float
    """At inputs that are table entries, where a rule fires in both. A degree is rounded by at most 1/512, so that n
    rules over k inputs are off by at most (n k / S + 1) / 512 where their strengths sum to S (k is 1 for the minimum):
    large where rules hardly fire at all."""
    firm: float
    """The largest where the strengths sum to at least `MIN_FIRING_STRENGTH`."""
    step: float
    """Largest change of the output between neighbouring entries of an input: an input between two entries is off by at
    most this much more."""
    silent: float
    """Share of the inputs at which rules fire so weakly that none fires in the model."""
    checked: int
    """Number of inputs that were compared."""
    complete: bool
    """Whether these were all inputs."""


def quantise(system: FuzzySystem, entries: int) -> QuantisedSystem:
    """Make the integer model, with ``entries`` entries per table.

    Raises
    ------
    ValueError
        For fewer than 2 or more than 65536 entries, more than 32 rules, or AND as product with too many entries, or
        terms whose strengths do not sum to one (the model does not divide there).
    """
    if not 2 <= entries <= 1 << 16:
        raise ValueError(f"entries is {entries}; it must be 2 to 65536")
    if system.conjunction == "product" and entries ** len(system.inputs) > MAX_COMBINATIONS:
        raise ValueError(f"{len(system.inputs)} inputs of {entries} entries are too many for a product; use fewer")
    model = make_tables(system, [np.linspace(each.low, each.high, entries) for each in system.inputs])
    return QuantisedSystem(system, model, entries)


def measure_errors(quantised: QuantisedSystem) -> ErrorBounds:
    """Compare the integer model with the real numbers at its table entries: all of them, or many at random."""
    system, entries = quantised.real, quantised.entries
    count = entries ** len(system.inputs)
    complete = count <= MAX_CHECKED
    if complete:
        indices = np.stack(np.unravel_index(np.arange(count), (entries,) * len(system.inputs)))
    else:
        indices = np.random.default_rng(0).integers(0, entries, (len(system.inputs), MAX_CHECKED))
    span = system.output.high - system.output.low
    output = quantised.evaluate(*indices)
    values = [quantised.positions(variable)[index] for variable, index in zip(system.inputs, indices, strict=True)]
    strengths = system.strengths(*values).sum(axis=1)
    fires = strengths > 0
    fires_in_both = fires & (quantised.model.strengths(*indices).sum(axis=1) > 0)
    errors = np.abs(output - system.evaluate(*values))[fires_in_both] / span
    return ErrorBounds(
        largest=float(errors.max(initial=0.0)),
        mean=float(errors.mean()) if errors.size else 0.0,
        firm=float(errors[strengths[fires_in_both] >= MIN_FIRING_STRENGTH].max(initial=0.0)),
        step=float(max(_largest_step(quantised, indices, axis, output) for axis in range(len(indices))) / span),
        silent=float((fires & ~fires_in_both).mean()),
        checked=indices.shape[1],
        complete=complete,
    )


def _largest_step(quantised: QuantisedSystem, indices: NDArray[np.intp], axis: int, output: Array) -> float:
    """Largest change of the output when one input moves on by an entry."""
    following = indices.copy()
    following[axis] = np.minimum(following[axis] + 1, quantised.entries - 1)
    return float(np.abs(quantised.evaluate(*following) - output).max())
