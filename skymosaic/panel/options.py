"""The options of a run: those of the library, the slider, and the fuzzy rules."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from golden_model.config import Config, preset_config
from golden_model.fuzzy.rules import MatchRules
from skymosaic.common.errors import InputError
from skymosaic.common.options import INPUT, options_of, respell
from skymosaic.features.methods import choose_method
from skymosaic.mosaicking.options import MosaicOptions

AUTOMATIC, OWN = "automatic", "own"
"""What the page shows for the library's default blending, which is None, and for rules that are none of the names."""
HARDWARE = ("rtl",)
"""A board is offered with its address."""
# What happens to damaged files is asked last.
LABELLED = {
    each.name: each for each in sorted(options_of(MosaicOptions), key=lambda each: each.group == INPUT) if each.label
}
"""The options that the page has."""
OPTION_VALUES = {each.name: each.choices for each in LABELLED.values() if each.choices}
OPTION_VALUES |= {"blending": (AUTOMATIC, *OPTION_VALUES["blending"]), "backend": ("golden", *HARDWARE)}
"""The values that the page offers for each option that has names: those of the library."""


@dataclass(frozen=True)
class SliderScale:
    """What the slider sets for a detector: a field of the front end, with a title and rising values by position."""

    title: str
    field: str
    values: Mapping[int, int]

    def position(self, value: int) -> int:
        """The lowest position whose value reaches ``value``."""
        return next((position for position, reached in self.values.items() if reached >= value), max(self.values))


# Harris responses span many decades, so a position is half an octave of the threshold. Each cell of an image keeps its
# best corners: a threshold below 1024 changes next to nothing on photographs, and hardly any corner is above 2**24. The
# slider has the range between, and below it the presets' 2.
HARRIS_THRESHOLDS = {19: 2} | {position: round(2 ** (position / 2)) for position in range(20, 49)}
SCALES = {
    "harris": SliderScale("Harris threshold", "threshold", HARRIS_THRESHOLDS),
    "fast": SliderScale("FAST threshold, gray levels", "threshold", {level: level for level in range(1, 121)}),
}
# The other detectors have no threshold in common.
KEY_POINTS = {position: round(2 ** (position / 2)) for position in range(14, 23)}
STRONGEST = SliderScale("Strongest key points", "max_features", KEY_POINTS)


@dataclass(frozen=True, kw_only=True)
class Options(MosaicOptions):
    """The options of a run; ``position`` is the slider's."""

    position: int

    @classmethod
    def of_preset(cls, preset: str) -> Options:
        """Options with the values of a preset."""
        config = preset_config(preset)
        own = config.front_end
        values: dict[str, Any] = {"preset": preset, "detector": own.detector, "descriptor": own.descriptor}
        return cls(position=_default_position(config, own.detector), **values)

    def changed(self, name: str, value: Any) -> Options:
        """A copy with one option changed; a new preset resets all others, a new detector the slider."""
        if name == "preset":
            return Options.of_preset(value)
        if value == OWN:
            # Only an edit makes rules of one's own; the page shows their name.
            return self
        change: dict[str, Any] = {name: None if value == AUTOMATIC else value}
        if name == "backend":
            change = backend_options(value)
        if name == "rules" and value == preset_config(self.preset).matcher.rule_base:
            change["rules"] = None
        changed = dataclasses.replace(self, **change)
        if name == "detector":
            return dataclasses.replace(changed, position=_default_position(preset_config(self.preset), value))
        return changed

    def shown(self, name: str) -> Any:
        """The value of an option as the page shows it."""
        if name == "backend":
            return self.backend_name
        value = getattr(self, name)
        if isinstance(value, MatchRules):
            return OWN
        if value is None:
            return preset_config(self.preset).matcher.rule_base if name == "rules" else AUTOMATIC
        return value

    @property
    def slider_scale(self) -> SliderScale:
        """What the slider sets."""
        return SCALES.get(self.detector or "", STRONGEST)

    @property
    def base_config(self) -> Config:
        """The preset's configuration with the fuzzy rules and the slider's value."""
        # Detector and descriptor first: choosing another detector resets the threshold, which the slider sets.
        _, config = choose_method(super().base_config, self.detector, self.descriptor)
        set_by_slider: Any = {self.slider_scale.field: self.slider_scale.values[self.position]}
        return dataclasses.replace(config, front_end=dataclasses.replace(config.front_end, **set_by_slider))


def fault_of(options: Options, photographs: int = 2) -> str:
    """Why the options cannot be combined, or not for this number of photographs; empty if they can."""
    try:
        options.check_for(max(photographs, 2))
    except (InputError, ValueError) as error:
        return in_labels(error)
    return ""


def in_labels(error: Exception) -> str:
    """What an error says, with the labels of the page in place of the names of options."""
    return respell(str(error), lambda name: LABELLED[name].label if name in LABELLED else name)


def backend_options(shown: str) -> dict[str, Any]:
    """The options of a backend by the name that the page shows, that of a board with its address."""
    backend, _, address = shown.partition(":")
    return {"backend": backend, "address": address or None}


def _default_position(preset: Config, detector: str) -> int:
    """The slider's position for the preset's threshold, or its number of key points."""
    _, config = choose_method(preset, detector, preset.front_end.descriptor)
    scale = SCALES.get(detector, STRONGEST)
    return scale.position(getattr(config.front_end, scale.field))
