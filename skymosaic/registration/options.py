"""The options of a registration, each written once, and what an interface has to know of an option.

The API's keyword arguments, the command line, the panel and the reference page take names, types, defaults, help and
valid values from the fields here and in `skymosaic.mosaicking.options`.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass, field
from typing import Any, TypedDict, TypeVar

from golden_model.config import MAX_FRAME_PX, PRESETS, Config, preset_config
from golden_model.feature.ilbp import PATTERNS
from sim.backends.interface import BACKENDS, Backend, Progress, silent
from skymosaic.errors import InputError
from skymosaic.features.descriptors import DESCRIPTORS
from skymosaic.features.detectors import DETECTORS
from skymosaic.features.methods import Method, check_backend, choose_method, load_backend_for
from skymosaic.geometry.estimators import ESTIMATORS, FUZZY_RANSAC, SCORINGS
from skymosaic.imagery.decoding import MIN_SIDE_PX
from skymosaic.imagery.images import DAMAGED

WORKING_WIDTH_PX = 1280
EFFORTS = ("fast", "normal", "thorough")
"""fast: one pass; normal: more where the first is weak; thorough: three scales always, more where they are weak."""
GROUPS = ("Input", "Registration", "Picture", "Map", "Output", "Machine")
"""Headings of the help, in its order."""
INPUT, REGISTRATION, PICTURE, MAP, OUTPUT, MACHINE = GROUPS

T = TypeVar("T")


@dataclass(frozen=True)
class Option:
    """What an interface has to know of an option.

    Attributes
    ----------
    help : str
        One sentence.
    group : str
        One of `GROUPS`.
    choices : tuple of str
        The names that it takes; empty where it takes no name.
    checked : bool
        Whether `check` refuses other names; otherwise the code that loads what is named does, with its own reason.
    above, minimum, maximum : float or None
        Limits of a number; ``above`` itself is not valid.
    flag : str
        On the command line.
    flag_unit : int
        The command line counts in multiples of this.
    live : bool
        Whether it applies to a mosaic that grows frame by frame.
    not_for_two, not_for_more : str
        Why it has no effect on two photographs, or on more; empty where it has one.
    name, default
        Of the dataclass field, filled in by `options_of`.
    """

    help: str
    group: str
    choices: tuple[str, ...] = ()
    checked: bool = True
    above: float | None = None
    minimum: float | None = None
    maximum: float | None = None
    flag: str = ""
    flag_unit: int = 1
    live: bool = False
    not_for_two: str = ""
    not_for_more: str = ""
    name: str = ""
    default: Any = None

    @property
    def valid(self) -> str:
        """The valid names, or the limits of a number, in words; empty where there are none."""
        limits = {"more than": self.above, "at least": self.minimum, "at most": self.maximum}
        words = [f"{limit} {number}" for limit, number in limits.items() if number is not None]
        return ", ".join(self.choices) or " and ".join(words)

    def check(self, value: Any) -> None:
        """Raise `InputError` for a name or a number that is not valid; None always is."""
        if value is None or not self.valid or not self.checked:
            return
        if self.choices and value not in self.choices:
            raise InputError(f"{self.name} is {value!r}; valid: {self.valid}")
        if not self.choices and not (
            math.isfinite(value)
            and (self.above is None or value > self.above)
            and (self.minimum is None or value >= self.minimum)
            and (self.maximum is None or value <= self.maximum)
        ):
            raise InputError(f"{self.name} is {value}; it must be {self.valid}")


def option(default: T, about: Option) -> T:
    """A dataclass field with its default and what is to be known of it."""
    described: T = field(default=default, metadata={"option": about})
    return described


def options_of(cls: type[FeatureOptions]) -> list[Option]:
    """The options of a class, group by group; fields without a description are for programs only."""
    options = [
        dataclasses.replace(
            about, name=each.name, default=each.default, flag=about.flag or f"--{each.name.replace('_', '-')}"
        )
        for each in dataclasses.fields(cls)
        if (about := each.metadata.get("option"))
    ]
    return sorted(options, key=lambda each: GROUPS.index(each.group))


@dataclass(frozen=True, kw_only=True)
class FeatureOptions:
    """How the features of one photograph are computed."""

    preset: str = option(
        "aerial",
        Option(
            "The project's own algorithm, or what the thesis describes.",
            REGISTRATION,
            choices=tuple(PRESETS),
            live=True,
        ),
    )
    config: Config | None = option(
        None, Option("A configuration that overrides the preset, from a TOML file.", REGISTRATION, live=True)
    )
    detector: str | None = option(
        None,
        Option(
            "Corners; by default as configured, or what suits the descriptor.",
            REGISTRATION,
            choices=DETECTORS,
            checked=False,
        ),
    )
    descriptor: str | None = option(
        None,
        Option(
            "Descriptor; by default as configured, or what suits the detector.",
            REGISTRATION,
            choices=DESCRIPTORS,
            checked=False,
        ),
    )
    backend: str | Backend = option(
        "golden",
        Option(
            "What computes features and matches; rtl is verilator, a board is board:HOST[:PORT].",
            MACHINE,
            choices=tuple(BACKENDS),
            checked=False,
            live=True,
        ),
    )
    working_width_px: int = option(
        WORKING_WIDTH_PX,
        Option(
            "Wider photographs are reduced to this width for registration.",
            REGISTRATION,
            flag="--working-width",
            minimum=MIN_SIDE_PX,
            maximum=MAX_FRAME_PX,
            live=True,
        ),
    )
    damaged: str = option(
        "refuse",
        Option(
            "A damaged JPEG: refuse it (a flight leaves it out), or keep what can be decoded.", INPUT, choices=DAMAGED
        ),
    )

    def check(self) -> None:
        """Refuse what is not valid.

        Raises
        ------
        InputError
            For an unknown name, an impossible value or an impossible combination; the message is one line.
        """
        for each in options_of(type(self)):
            each.check(getattr(self, each.name))
        method, _ = self.choose_method()
        if isinstance(self.backend, str):
            check_backend(method, self.backend)

    @property
    def base_config(self) -> Config:
        """The configuration, or that of the preset."""
        return self.config or preset_config(self.preset)

    @property
    def backend_name(self) -> str:
        """The backend's name; of an object, its class."""
        return self.backend if isinstance(self.backend, str) else type(self.backend).__name__

    @property
    def keeps_damaged(self) -> bool:
        """Whether damaged photographs are used as far as they can be decoded."""
        return self.damaged == "keep"

    def open_backend(self, method: Method, progress: Progress = silent) -> Backend:
        """The backend that computes ``method``; ``progress`` receives lines about the first build of a simulation."""
        return load_backend_for(method, self.backend, progress) if isinstance(self.backend, str) else self.backend

    def choose_method(self) -> tuple[Method, Config]:
        """The detector and descriptor, and the configuration adapted to them.

        Raises
        ------
        InputError
            For an unknown name or an impossible combination.
        """
        return choose_method(self.base_config, self.detector, self.descriptor)


@dataclass(frozen=True, kw_only=True)
class RegistrationOptions(FeatureOptions):
    """How two photographs are registered."""

    estimator: str = option(
        "prosac",
        Option(
            "Robust estimator of the homography.",
            REGISTRATION,
            choices=ESTIMATORS,
            not_for_more="more than two photographs are linked by prosac, whose result the layout then refines",
        ),
    )
    effort: str | None = option(
        None,
        Option(
            "One pass; more frames where that is weak (normal, the default); always three scales (thorough).",
            REGISTRATION,
            choices=EFFORTS,
            not_for_more="more than two photographs are linked by one pass each",
        ),
    )
    refine: bool = option(
        False,
        Option(
            "Second, guided pass; its result counts only if it fits unseen matches better.",
            REGISTRATION,
            not_for_more="the layout of more than two photographs is refined by all links",
        ),
    )
    seed: int = option(0, Option("Seed of the robust estimator.", REGISTRATION, minimum=0, live=True))

    def choose_method(self) -> tuple[Method, Config]:
        """As of `FeatureOptions`, checked against the estimator and the second pass."""
        config = self.base_config
        if self.estimator == FUZZY_RANSAC:
            # Fuzzy RANSAC has rules of its own, which replace those of the matcher.
            config = dataclasses.replace(config, matcher=dataclasses.replace(config.matcher, rule_base="none"))
        method, config = choose_method(config, self.detector, self.descriptor)
        if self.refine and method.descriptor not in PATTERNS:
            raise InputError(
                f"refinement describes the images again by ILBP, not by {method.descriptor}; leave one out"
            )
        return method, config

    def choose_effort(self, method: Method) -> str:
        """The effort that was asked for, or the default of the method.

        Raises
        ------
        InputError
            For more than one pass with a method or a backend that is not made for it.
        """
        if self.backend_name.partition(":")[0] == "board":
            # A run on the board has frames of one size; those of further passes have other sizes.
            if self.effort not in (None, "fast"):
                raise InputError(f"effort {self.effort} needs frames of several sizes, a board takes one; choose fast")
            return "fast"
        # Other methods have scale spaces of their own, and the thesis's descriptor is to be seen as it is.
        oriented = method.descriptor in PATTERNS and PATTERNS[method.descriptor].oriented
        has_passes = oriented and self.estimator in SCORINGS
        if self.effort not in (None, "fast") and not has_passes:
            raise InputError(
                f"effort {self.effort} needs an oriented ILBP descriptor and the estimator {' or '.join(SCORINGS)}, "
                f"not {method.descriptor} and {self.estimator}; leave it out or choose fast"
            )
        return self.effort or ("normal" if has_passes else "fast")


class FeatureKeywords(TypedDict, total=False):
    """The fields of `FeatureOptions` as keyword arguments, which type checkers and editors know."""

    preset: str
    config: Config | None
    detector: str | None
    descriptor: str | None
    backend: str | Backend
    working_width_px: int
    damaged: str


class RegistrationKeywords(FeatureKeywords, total=False):
    """The fields of `RegistrationOptions` as keyword arguments."""

    estimator: str
    effort: str | None
    refine: bool
    seed: int
