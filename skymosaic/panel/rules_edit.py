"""Other rules for the pair that is shown: tried at once, on features that are kept."""

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from golden_model.feature.ilbp import PATTERNS
from golden_model.fuzzy.rules import MatchRules
from golden_model.fuzzy.system import FuzzySystem
from skymosaic.common.errors import InputError
from skymosaic.imagery.images import save_bytes
from skymosaic.panel.options import Options
from skymosaic.panel.results import EDITED_RULES, MosaicResult
from skymosaic.registration.extraction import Features, extract
from skymosaic.registration.register import register

DEGREES = {
    "Ramp": (0.0, 1.0), "Triangle": (0.0, 1.0, 0.0), "Trapezoid": (0.0, 1.0, 1.0, 0.0), "Rectangle": (1.0, 1.0),
    "ZShape": (1.0, 0.0), "SShape": (0.0, 1.0), "PiShape": (0.0, 1.0, 1.0, 0.0), "Gaussian": (1.0,), "Bell": (1.0,),
    "Cosine": (1.0,), "Spike": (1.0,), "Sigmoid": (0.5,),
}  # fmt: skip
"""Degree at each parameter that is a position, by the shape of a term; of a Discrete one, it is the next parameter.
Other shapes are edited as text."""
X_STEPS, Y_STEPS = 200, 100
"""Corners move in these shares of the range."""
MAX_CORNERS = 24
"""An input with more corners is edited as text."""


@dataclass(frozen=True)
class Corner:
    """A corner of an input's terms."""

    x: float
    y: float
    """Position in the input's unit, and degree."""
    members: tuple[tuple[str, int], ...]
    """Terms, and their parameters that are this position. Terms of a product sum to one, so what meets in a corner
    moves together."""


def find_corners(system: FuzzySystem, number: int) -> list[Corner]:
    """The corners of an input's terms, in the order of the text; none where they are too many to show."""
    corners: dict[object, Corner] = {}
    for term in system.inputs[number].terms.values():
        is_discrete = term.shape == "Discrete"
        positions = range(0, len(term.parameters), 2) if is_discrete else range(len(DEGREES.get(term.shape, ())))
        for index in positions:
            x = term.parameters[index]
            y = term.parameters[index + 1] if is_discrete else DEGREES[term.shape][index]
            key = x if system.conjunction == "product" else (term.name, index)
            if np.isfinite(x):
                before = corners.setdefault(key, Corner(x, y, ()))
                corners[key] = replace(before, members=(*before.members, (term.name, index)))
    return list(corners.values()) if len(corners) <= MAX_CORNERS else []


def move_corner(text: str, number: int, corner: int, x: float, y: float) -> str:
    """The rules with a corner of an input at another place; the degree changes only of points that have one."""
    system = MatchRules(text).system
    variable, members = system.inputs[number], find_corners(system, number)[corner].members
    changed = {name: list(term.parameters) for name, term in variable.terms.items()}
    for order, (name, index) in enumerate(members):
        changed[name][index] = round(x * X_STEPS / variable.high) * variable.high / X_STEPS
        if variable.terms[name].shape == "Discrete" and len(members) <= 2:
            degree = round(y * Y_STEPS) / Y_STEPS
            changed[name][index + 1] = 1 - degree if order else degree
    lines, inside = text.splitlines(), False
    for line, row in enumerate(lines):
        key, _, value = (part.strip() for part in row.partition(":"))
        inside = value == variable.name if key.endswith("Variable") else inside
        if inside and key == "term" and (words := value.split())[0] in dict(members):
            parameters = " ".join(f"{parameter:.6g}" for parameter in changed[words[0]])
            lines[line] = f"  term: {words[0]} {words[1]} {parameters}"
    return "\n".join(lines) + "\n"


class RulesEdit:
    """Rules for the pair of a result that `applies_to`: every version until now, and the pair as the last decides."""

    def __init__(self, result: MosaicResult) -> None:
        rules = result.pair.config.matcher.rules
        assert rules is not None
        self._result, self._texts = result, [rules.text]
        self.pair, self.fault = result.pair, ""
        """The fault is why the last change was refused; empty if it was not."""

    @staticmethod
    def applies_to(result: MosaicResult) -> bool:
        """Whether rules decide the matches of a result."""
        pair = result.pair
        return pair.method.descriptor in PATTERNS and pair.config.matcher.rules is not None

    @property
    def rules(self) -> MatchRules:
        """The rules as they are."""
        return MatchRules(self._texts[-1])

    @property
    def versions(self) -> int:
        """How many versions there are, the first included."""
        return len(self._texts)

    def change(self, text: str, *, after: int | None = None) -> None:
        """Try other rules; they follow the version ``after``, and replace the later ones, or follow the last."""
        self.fault = ""
        try:
            self._try(MatchRules(text))
        except (ValueError, InputError) as error:
            self.fault = str(error)
            return
        del self._texts[after or self.versions :]
        if text != self._texts[-1]:
            self._texts.append(text)

    def undo(self) -> None:
        """Go back to the version before, or from a text that was refused to the last version."""
        if not self.fault and self.versions > 1:
            self._texts.pop()
        self.change(self._texts[-1])

    def reset(self) -> None:
        """Go back to the rules of the result; this can be undone, too."""
        self.change(self._texts[0])

    @cached_property
    def _features(self) -> tuple[Features, Features]:
        """Those of the working pictures, which every version of the rules matches."""
        left, right = (self._result.pictures / Path(shown.href).name for shown in self._result.working)
        return extract(left, self._options), extract(right, self._options)

    @property
    def _options(self) -> Options:
        """Those of the result; the golden model computes what its hardware did."""
        return self._result.options.changed("backend", "golden")

    def _try(self, rules: MatchRules) -> None:
        """Register the pair's working pictures with other rules, and write these into the result's folder."""
        pair = register(*self._features, self._options, rules=rules)
        # Named as the photographs are, not as their working pictures.
        self.pair = replace(pair, left=self.pair.left, right=self.pair.right).without_pixels()
        save_bytes(self._result.folder / EDITED_RULES, rules.text.encode())
