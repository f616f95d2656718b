"""The options of a run and their values.

Every list of values is the library's own, so the panel offers exactly what the library has.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any

from golden_model.config import PRESETS, RULE_BASES, Config, preset_config
from sim.backends.interface import BACKENDS
from skymosaic.compositing.blend import METHODS as BLENDINGS
from skymosaic.errors import InputError
from skymosaic.features.descriptors import DESCRIPTORS
from skymosaic.features.detectors import DETECTORS, FRONT_END_DETECTORS
from skymosaic.features.methods import Method, check_backend, choose_method
from skymosaic.geometry.estimators import ESTIMATORS

SOFTWARE = "golden"
DAMAGED = ("refuse", "keep")
AUTOMATIC = "automatic"
"""The library's default blending: by distance for two photographs, multi-band along seams for more."""
# "verilator" is left out because "rtl" is another name for it.
HARDWARE = tuple(name for name in BACKENDS if name not in (SOFTWARE, "verilator"))
OPTION_VALUES = {
    "preset": tuple(PRESETS),
    "detector": DETECTORS,
    "descriptor": DESCRIPTORS,
    "rule_base": RULE_BASES,
    "estimator": ESTIMATORS,
    "blending": (AUTOMATIC, *BLENDINGS),
    "backend": (SOFTWARE, *HARDWARE),
    "damaged": DAMAGED,
}
"""The values of each option."""


@dataclass(frozen=True)
class Scale:
    """What the slider sets for a detector, at whole positions from ``lowest`` to ``highest``.

    Harris responses span many decades, so a step is half an octave of the threshold; for FAST it is a gray level. The
    other detectors have no threshold in common: for them the slider sets how many of the strongest key points to keep.
    Each cell of an image keeps its best corners, so a Harris threshold below 1024 changes next to nothing on
    photographs, and hardly any corner is above 2**24: the slider has the range between, and the presets' 2 below it.

    Attributes
    ----------
    title : str
    lowest, highest : int
    steps_per_octave : int
        Positions per doubling of the value; 0 if the position is the value.
    at_lowest : int or None
        The value at the lowest position, where it is not the usual one.
    """

    title: str
    lowest: int
    highest: int
    steps_per_octave: int = 0
    at_lowest: int | None = None

    def value(self, position: int) -> int:
        """The threshold or number of key points at a position."""
        if position == self.lowest and self.at_lowest is not None:
            return self.at_lowest
        return round(2 ** (position / self.steps_per_octave)) if self.steps_per_octave else position

    def position(self, value: int) -> int:
        """The lowest position whose value reaches ``value``."""
        return next((p for p in range(self.lowest, self.highest) if self.value(p) >= value), self.highest)


SCALES = {
    "harris": Scale("Harris threshold", 19, 48, steps_per_octave=2, at_lowest=2),
    "fast": Scale("FAST threshold, gray levels", 1, 120),
}
STRONGEST = Scale("Strongest key points", 14, 22, steps_per_octave=2)


@dataclass(frozen=True)
class Options:
    """The options of a run; ``position`` is the slider's, the others are named as on the command line."""

    preset: str
    detector: str
    descriptor: str
    position: int
    rule_base: str
    estimator: str = "prosac"
    blending: str = AUTOMATIC
    backend: str = SOFTWARE
    refine: bool = False
    damaged: str = DAMAGED[0]

    @classmethod
    def of_preset(cls, preset: str) -> Options:
        """The options of a preset."""
        config = preset_config(preset)
        detector = config.front_end.detector
        return cls(
            preset=preset,
            detector=detector,
            descriptor=config.front_end.descriptor,
            position=_usual_position(config, detector),
            rule_base=config.matcher.rule_base,
        )

    def changed(self, name: str, value: Any) -> Options:
        """These options with one of them changed; a new preset resets all others, a new detector the slider."""
        if name == "preset":
            return Options.of_preset(value)
        changed = dataclasses.replace(self, **{name: value})
        if name == "detector":
            position = _usual_position(preset_config(self.preset), changed.detector)
            return dataclasses.replace(changed, position=position)
        return changed

    @property
    def scale(self) -> Scale:
        """What the slider sets."""
        return SCALES.get(self.detector, STRONGEST)

    def resolve(self, photographs: int = 2) -> tuple[Method, Config]:
        """The method and configuration that these options stand for.

        Raises
        ------
        InputError
            If the options cannot be combined, or not for this number of photographs.
        """
        base = preset_config(self.preset)
        base = dataclasses.replace(base, matcher=dataclasses.replace(base.matcher, rule_base=self.rule_base))
        method, config = choose_method(base, self.detector, self.descriptor)
        check_backend(method, self.backend)
        value = self.scale.value(self.position)
        own = config.front_end
        if photographs > 2 and (not method.on_accelerator or self.estimator != "prosac" or self.refine):
            raise InputError(
                "more than two photographs need Harris or FAST with ILBP, prosac and no second pass; choose these, "
                "or keep only two photographs"
            )
        if self.detector in FRONT_END_DETECTORS:
            return method, dataclasses.replace(config, front_end=dataclasses.replace(own, threshold=value))
        return method, dataclasses.replace(config, front_end=dataclasses.replace(own, max_features=value))


def fault_of(options: Options, photographs: int = 2) -> str:
    """Why the options cannot be combined, or not for this number of photographs; empty if they can."""
    try:
        options.resolve(photographs)
    except (InputError, ValueError) as error:
        return str(error)
    return ""


def _usual_position(preset: Config, detector: str) -> int:
    """The slider's position for the preset's threshold, or its number of key points."""
    _, config = choose_method(preset, detector, preset.front_end.descriptor)
    own = config.front_end
    value = own.threshold if detector in FRONT_END_DETECTORS else own.max_features
    return SCALES.get(detector, STRONGEST).position(value)
