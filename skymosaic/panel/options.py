"""The options of a run: those of the library, the slider, and the fuzzy rules."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from golden_model.config import RULE_BASES, Config, preset_config
from golden_model.fuzzy.rules import MatchRules
from sim.backends.interface import BACKENDS
from skymosaic.common.errors import InputError
from skymosaic.common.options import options_of
from skymosaic.features.detectors import FRONT_END_DETECTORS
from skymosaic.features.methods import choose_method
from skymosaic.mosaicking.options import MosaicOptions

AUTOMATIC, OWN = "automatic", "own"
"""What the page shows for the library's default blending, which is None, and for rules that are none of the names."""
HARDWARE = tuple(name for name in BACKENDS if name != "golden")
OPTION_VALUES = {each.name: each.choices for each in options_of(MosaicOptions) if each.choices}
OPTION_VALUES |= {
    "rule_base": RULE_BASES,
    "blending": (AUTOMATIC, *OPTION_VALUES["blending"]),
    "backend": ("golden", *HARDWARE),
}
"""The values that the page offers for each option: those that the library has."""


@dataclass(frozen=True)
class SliderScale:
    """What the slider sets for a detector: a title, and the value at each position, rising."""

    title: str
    values: Mapping[int, int]

    def position(self, value: int) -> int:
        """The lowest position whose value reaches ``value``."""
        return next((position for position, reached in self.values.items() if reached >= value), max(self.values))


# Harris responses span many decades, so a position is half an octave of the threshold. Each cell of an image keeps its
# best corners: a threshold below 1024 changes next to nothing on photographs, and hardly any corner is above 2**24. The
# slider has the range between, and below it the presets' 2.
HARRIS_THRESHOLDS = {19: 2} | {position: round(2 ** (position / 2)) for position in range(20, 49)}
SCALES = {
    "harris": SliderScale("Harris threshold", HARRIS_THRESHOLDS),
    "fast": SliderScale("FAST threshold, gray levels", {level: level for level in range(1, 121)}),
}
# The other detectors have no threshold in common.
STRONGEST = SliderScale("Strongest key points", {position: round(2 ** (position / 2)) for position in range(14, 23)})


@dataclass(frozen=True, kw_only=True)
class Options(MosaicOptions):
    """The options of a run; ``position`` is the slider's, ``rule_base`` that of the matcher's configuration."""

    position: int
    rule_base: str | MatchRules

    @classmethod
    def of_preset(cls, preset: str) -> Options:
        """Options with the values of a preset."""
        config = preset_config(preset)
        detector = config.front_end.detector
        return cls(
            preset=preset,
            detector=detector,
            descriptor=config.front_end.descriptor,
            position=_default_position(config, detector),
            rule_base=config.matcher.rule_base,
        )

    def changed(self, name: str, value: Any) -> Options:
        """A copy with one option changed; a new preset resets all others, a new detector the slider."""
        if name == "preset":
            return Options.of_preset(value)
        if value == OWN:
            # Only an edit makes rules of one's own; the page shows their name.
            return self
        change: dict[str, Any] = {name: None if value == AUTOMATIC else value}
        changed = dataclasses.replace(self, **change)
        if name == "detector":
            return dataclasses.replace(changed, position=_default_position(preset_config(self.preset), value))
        return changed

    def shown(self, name: str) -> Any:
        """The value of an option as the page shows it."""
        value = getattr(self, name)
        if isinstance(value, MatchRules):
            return OWN
        return AUTOMATIC if name == "blending" and value is None else value

    @property
    def slider_scale(self) -> SliderScale:
        """What the slider sets."""
        return SCALES.get(self.detector or "", STRONGEST)

    @property
    def base_config(self) -> Config:
        """The preset's configuration with the fuzzy rules and the slider's value."""
        base = preset_config(self.preset)
        base = dataclasses.replace(base, matcher=dataclasses.replace(base.matcher, rule_base=self.rule_base))
        # Detector and descriptor first: choosing another detector resets the threshold, which the slider sets.
        _, config = choose_method(base, self.detector, self.descriptor)
        value = self.slider_scale.values[self.position]
        if self.detector in FRONT_END_DETECTORS:
            return dataclasses.replace(config, front_end=dataclasses.replace(config.front_end, threshold=value))
        return dataclasses.replace(config, front_end=dataclasses.replace(config.front_end, max_features=value))


def fault_of(options: Options, photographs: int = 2) -> str:
    """Why the options cannot be combined, or not for this number of photographs; empty if they can."""
    try:
        options.check_for(max(photographs, 2))
    except (InputError, ValueError) as error:
        return str(error)
    return ""


def _default_position(preset: Config, detector: str) -> int:
    """The slider's position for the preset's threshold, or its number of key points."""
    _, config = choose_method(preset, detector, preset.front_end.descriptor)
    own = config.front_end
    value = own.threshold if detector in FRONT_END_DETECTORS else own.max_features
    return SCALES.get(detector, STRONGEST).position(value)
