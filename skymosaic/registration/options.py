"""The options of a registration, each written once.

Keyword arguments, command line, panel and reference page take names, types, defaults, help and valid values from here
and from `skymosaic.mosaicking.options`.
"""

from dataclasses import dataclass, replace
from typing import TypedDict

from golden_model.config import MAX_FRAME_PX, MIN_FRAME_PX, PRESETS, RULE_BASES, Config, preset_config
from golden_model.feature.ilbp import PATTERNS
from golden_model.fuzzy.rules import MatchRules
from sim.backends.interface import BACKENDS, Backend, Progress, silent
from skymosaic.common.errors import InputError
from skymosaic.common.options import INPUT, MACHINE, document_options, option, options_of
from skymosaic.features.descriptors import DESCRIPTORS
from skymosaic.features.detectors import DETECTORS
from skymosaic.features.methods import HostBackend, Method, check_backend, choose_method, load_backend_for
from skymosaic.geometry.estimators import ESTIMATORS, FUZZY_RANSAC, PROSAC

WORKING_WIDTH_PX = 1280
EFFORTS = ("fast", "normal", "thorough")
"""fast: one pass; normal: more where the first is weak; thorough: three scales always, more where they are weak."""


@document_options
@dataclass(frozen=True, kw_only=True)
class FeatureOptions:
    """How the features of one photograph are computed."""

    preset: str = option("aerial", "The project's own algorithm, or what the thesis describes.", choices=tuple(PRESETS))
    config: Config | None = option(None, "A configuration that overrides the preset, from a TOML file.")
    rules: str | MatchRules | None = option(
        None,
        "Fuzzy rules that decide matches: a name, or an .fll file; by default as configured.",
        choices=RULE_BASES,
        checked=False,
    )
    detector: str | None = option(
        None,
        "Corner detector; by default as configured, or what suits the descriptor.",
        choices=DETECTORS,
        checked=False,
    )
    descriptor: str | None = option(
        None,
        "Descriptor; by default as configured, or what suits the detector.",
        choices=DESCRIPTORS,
        checked=False,
    )
    backend: str | Backend = option(
        "golden",
        "What computes features and matches; rtl is verilator, a board is board:HOST[:PORT].",
        MACHINE,
        choices=tuple(BACKENDS),
        checked=False,
    )
    working_width_px: int = option(
        WORKING_WIDTH_PX,
        "Wider photographs are reduced to this width for registration.",
        minimum=MIN_FRAME_PX,
        maximum=MAX_FRAME_PX,
    )
    damaged: str = option(
        "refuse",
        "A damaged JPEG or TIFF: refuse it (a flight leaves it out), or keep what can be decoded.",
        INPUT,
        choices=("refuse", "keep"),
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
        if not isinstance(self.backend, HostBackend):
            check_backend(method, self.backend_name)

    @property
    def base_config(self) -> Config:
        """The configuration, or that of the preset, with the rules."""
        config = self.config or preset_config(self.preset)
        if self.rules is None:
            return config
        try:
            return replace(config, matcher=replace(config.matcher, rule_base=self.rules))
        except ValueError as error:
            raise InputError(str(error)) from None

    @property
    def backend_name(self) -> str:
        """The backend's name; of an object, its class."""
        return self.backend if isinstance(self.backend, str) else type(self.backend).__name__

    @property
    def takes_one_size(self) -> bool:
        """Whether the backend takes frames of one size in a run, as a board does."""
        if isinstance(self.backend, str):
            return self.backend.partition(":")[0] == "board"
        return self.backend.takes_one_size

    @property
    def keeps_damaged(self) -> bool:
        """Whether damaged photographs are used as far as they can be decoded."""
        return self.damaged == "keep"

    def open_backend(self, method: Method, progress: Progress = silent) -> Backend:
        """Load the backend that computes ``method``; ``progress`` receives lines about a simulation's first build."""
        return load_backend_for(method, self.backend, progress) if isinstance(self.backend, str) else self.backend

    def choose_method(self) -> tuple[Method, Config]:
        """Choose detector and descriptor, and adapt the configuration to them.

        Raises
        ------
        InputError
            For an unknown name or an impossible combination.
        """
        return self._choose_method(self.base_config)

    def _choose_method(self, base: Config) -> tuple[Method, Config]:
        method, config = choose_method(base, self.detector, self.descriptor)
        if self.rules is not None and config.matcher.rule_base != self.rules:
            raise InputError(f"rules decide matches of ILBP descriptors, not of {method.descriptor}; leave one out")
        return method, config


@document_options
@dataclass(frozen=True, kw_only=True)
class RegistrationOptions(FeatureOptions):
    """How two photographs are registered."""

    estimator: str = option(
        "prosac",
        "Robust estimator of the homography.",
        choices=ESTIMATORS,
        not_for_more="more than two photographs are linked by prosac, whose result the layout then refines",
    )
    effort: str | None = option(
        None,
        "fast: one pass; normal, the default: more frames where that is weak; thorough: always three scales.",
        choices=EFFORTS,
        not_for_more="more than two photographs are linked by one pass each",
    )
    refine: bool = option(
        False,
        "Refit to the whole overlap by dense flow, if more of it fits then; otherwise only where the verdict is "
        "check or poor.",
        not_for_more="the layout of more than two photographs is refined by all links",
    )
    accept_poor: bool = option(
        False,
        "Deliver a poor pair even where its inliers cover less than a quarter of the overlap.",
        not_for_more="the layout of more than two photographs judges their links together",
    )
    seed: int = option(0, "Seed of the robust estimator.", minimum=0)

    def choose_method(self) -> tuple[Method, Config]:
        """Choose as `FeatureOptions` does, for the estimator."""
        config = self.base_config
        if self.estimator == FUZZY_RANSAC:
            # Fuzzy RANSAC has rules of its own, which replace those of the matcher.
            if self.rules not in (None, "none"):
                raise InputError(f"{FUZZY_RANSAC} has rules of its own; leave out either")
            config = replace(config, matcher=replace(config.matcher, rule_base="none"))
        return self._choose_method(config)

    def choose_effort(self, method: Method) -> str:
        """Choose the effort: the one that is asked for, or the default of the method.

        Raises
        ------
        InputError
            For more than one pass with a method or a backend that allows only one.
        """
        if self.takes_one_size:
            # Frames of further passes have other sizes.
            if self.effort not in (None, "fast"):
                raise InputError(f"effort {self.effort} needs frames of several sizes, a board takes one; choose fast")
            return "fast"
        # Other methods search scales themselves, and the thesis's descriptor is measured without help.
        oriented = method.descriptor in PATTERNS and PATTERNS[method.descriptor].oriented
        has_passes = oriented and self.estimator == PROSAC
        if self.effort not in (None, "fast") and not has_passes:
            raise InputError(
                f"effort {self.effort} needs an oriented ILBP descriptor and the estimator {PROSAC}, "
                f"not {method.descriptor} and {self.estimator}; leave it out or choose fast"
            )
        return self.effort or ("normal" if has_passes else "fast")


# Keyword arguments named field by field, because type checkers cannot derive them from a dataclass; a test holds the
# two together.
class FeatureKeywords(TypedDict, total=False):
    """The fields of `FeatureOptions` as keyword arguments, which type checkers and editors know."""

    preset: str
    config: Config | None
    rules: str | MatchRules | None
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
    accept_poor: bool
    seed: int
