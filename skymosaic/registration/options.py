"""The options of a registration, each written once.

Keyword arguments, command line, panel and reference page take names, types, defaults, sentences, limits and labels from
here and from `skymosaic.mosaicking.options`.
"""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal, get_args

from golden_model.config import MAX_FRAME_PX, MIN_FRAME_PX, RULE_BASES, Config, Preset, RuleBase, preset_config
from golden_model.config_file import load_config
from golden_model.feature.ilbp import PATTERNS
from golden_model.fuzzy.rules import MatchRules, load_rules
from sim.backends.interface import Backend, Progress, silent
from skymosaic.common.errors import InputError
from skymosaic.common.options import INPUT, MACHINE, Checked, document_options, option
from skymosaic.features.backends import BackendName, load_backend
from skymosaic.features.descriptors import Descriptor
from skymosaic.features.detectors import DETECTORS, FRONT_END_DETECTORS, Detector
from skymosaic.features.methods import GIVEN, HostBackend, Method, choose_method
from skymosaic.geometry.estimators import FUZZY_RANSAC, PROSAC, Estimator

WORKING_WIDTH_PX = 1280
Damaged = Literal["refuse", "keep"]
Effort = Literal["fast", "normal", "thorough"]
EFFORTS: tuple[Effort, ...] = get_args(Effort)
"""fast: one pass; normal: more where the first is weak; thorough: three scales always, more where they are weak."""


def read_rules(given: str) -> RuleBase | MatchRules:
    """The rules in an ``.fll`` or ``.fis`` file; a name stays as it is.

    Raises
    ------
    InputError
        For an unknown name.
    ValueError
        For a file that holds no rules for matches.
    """
    if Path(given).suffix:
        return load_rules(Path(given))
    for name in RULE_BASES:
        if name == given:
            return name
    raise InputError(f"`rules` is {given!r}; valid: {', '.join(RULE_BASES)}, or an .fll or .fis file")


@dataclass(frozen=True, kw_only=True)
class ConfigOptions(Checked):
    """What is computed."""

    preset: Preset = option("aerial", "The project's own algorithm, or what the thesis describes.", label="Preset")
    config: Config | None = option(
        None, "A configuration that overrides the preset, from a TOML file.", read=load_config, read_with=("preset",)
    )
    rules: RuleBase | MatchRules | None = option(
        None,
        "Fuzzy rules that decide matches: a name, or an .fll or .fis file; by default as configured.",
        label="Fuzzy rules",
        read=read_rules,
    )

    @property
    def base_config(self) -> Config:
        """The configuration, or that of the preset, with the rules."""
        config = self.config or preset_config(self.preset)
        if self.rules is None:
            return config
        return replace(config, matcher=replace(config.matcher, rule_base=self.rules))


@dataclass(frozen=True, kw_only=True)
class BackendOptions(Checked):
    """What computes it."""

    backend: BackendName | Backend = option(
        "golden", "What computes features and matches; rtl simulates the hardware.", MACHINE, label="Backend"
    )
    address: str | None = option(None, "The board, HOST[:PORT], for `backend` board.", MACHINE)

    def check(self) -> None:
        """Refuse what is not valid; a board has an address, and nothing else has."""
        super().check()
        if self.address is None and self.backend == "board":
            raise InputError("`backend` board: the address of the board is missing; give it with `address`")
        if self.address is not None and self.backend != "board":
            raise InputError(f"`address` {self.address} is for a board; choose `backend` board, or leave it out")

    @property
    def backend_name(self) -> str:
        """The backend's name, of a board with its address; of an object, its class."""
        if not isinstance(self.backend, str):
            return type(self.backend).__name__
        return self.backend if self.address is None else f"{self.backend}:{self.address}"

    def open_backend(self, method: Method | None = None, progress: Progress = silent) -> Backend:
        """Load the backend, or the one that computes ``method``; ``progress`` receives lines about a first build."""
        if not isinstance(self.backend, str):
            return self.backend
        if method is not None and not method.on_accelerator:
            return HostBackend(method)
        return load_backend(self.backend_name, progress=progress)


@dataclass(frozen=True, kw_only=True)
class PhotographOptions(ConfigOptions, BackendOptions):
    """How photographs come to the front end."""

    working_width_px: int = option(
        WORKING_WIDTH_PX,
        "Wider photographs are reduced to this width for registration.",
        minimum=MIN_FRAME_PX,
        maximum=MAX_FRAME_PX,
    )
    damaged: Damaged = option(
        "refuse",
        "A damaged JPEG or TIFF: refuse it (a flight leaves it out), or keep what can be decoded.",
        INPUT,
        label="Damaged file",
    )

    @property
    def keeps_damaged(self) -> bool:
        """Whether damaged photographs are used as far as they can be decoded."""
        return self.damaged == "keep"


@dataclass(frozen=True, kw_only=True)
class Seeded(Checked):
    """What draws samples at random."""

    seed: int = option(0, "Seed of the robust estimator.", minimum=0)


@document_options
@dataclass(frozen=True, kw_only=True)
class FeatureOptions(PhotographOptions):
    """How the features of one photograph are computed."""

    detector: Detector | None = option(
        None, "Corner detector; by default as configured, or what suits the descriptor.", label="Detector"
    )
    descriptor: Descriptor | None = option(
        None, "Descriptor; by default as configured, or what suits the detector.", label="Descriptor"
    )

    def check(self) -> None:
        """Refuse what is not valid, and methods that do not exist or not on the backend."""
        if str(self.detector) == "freak":
            raise InputError(
                f"freak is a descriptor, no detector; name it as `descriptor`, with {', '.join(DETECTORS)}"
            )
        super().check()
        method, _ = self.choose_method()
        runs_on_host = self.backend == "golden" or isinstance(self.backend, HostBackend)
        if not runs_on_host and not method.on_accelerator:
            raise InputError(
                f"`backend` {self.backend_name} computes only {', '.join(FRONT_END_DETECTORS)} with ILBP descriptors; "
                f"{method.detector} with {method.descriptor} runs on the host; leave out `backend`"
            )

    def choose_method(self) -> tuple[Method, Config]:
        """Choose detector and descriptor, and adapt the configuration to them.

        Raises
        ------
        InputError
            For an impossible combination.
        """
        method, config = choose_method(self.base_config, self.detector, self.descriptor)
        if self.rules is not None and config.matcher.rule_base != self.rules:
            raise InputError(f"`rules` decide matches of ILBP descriptors, not of {method.descriptor}; leave one out")
        return method, config


@document_options
@dataclass(frozen=True, kw_only=True)
class RegistrationOptions(Seeded, FeatureOptions):
    """How two photographs are registered."""

    estimator: Estimator = option(
        "prosac",
        "Robust estimator of the homography.",
        label="Estimator",
        not_for_more="more than two photographs are linked by prosac, whose result the layout then refines",
    )
    effort: Effort | None = option(
        None,
        "fast: one pass; normal, the default: more frames where that is weak; thorough: always three scales.",
        not_for_more="more than two photographs are linked by one pass each",
    )
    accept_poor: bool = option(
        False,
        "Deliver a poor pair even where its inliers cover so little of the overlap that most is a guess.",
        label="Deliver a poor pair",
        not_for_more="the layout of more than two photographs judges their links together",
    )

    @property
    def base_config(self) -> Config:
        """As that of `ConfigOptions`; fuzzy RANSAC has rules of its own, which replace those of the matcher."""
        config = super().base_config
        if self.estimator != FUZZY_RANSAC:
            return config
        if self.rules not in (None, "none"):
            raise InputError(f"`estimator` {FUZZY_RANSAC} has rules of its own; leave out either")
        return replace(config, matcher=replace(config.matcher, rule_base="none"))

    def choose_given(self) -> tuple[Method, Config]:
        """As `choose_method`, for matches that are given; raises for options that would have no effect on them."""
        for name in ("detector", "descriptor", "rules", "backend", "effort"):
            if getattr(self, name) != getattr(type(self), name):
                raise InputError(f"`{name}` has no effect on matches that are given; leave it out")
        config = self.base_config
        return Method(GIVEN, GIVEN), replace(config, matcher=replace(config.matcher, rule_base="none"))

    def choose_effort(self, method: Method) -> Effort:
        """Choose the effort: the one that is asked for, or the default of the method.

        Raises
        ------
        InputError
            For more than one pass with a method or a backend that allows only one.
        """
        # Frames of further passes have other sizes.
        if self.backend == "board" or getattr(self.backend, "takes_one_size", False):
            if self.effort not in (None, "fast"):
                raise InputError(
                    f"`effort` {self.effort} needs frames of several sizes, a board takes one; choose fast"
                )
            return "fast"
        # Other methods search scales themselves, and the thesis's descriptor is measured without help.
        oriented = method.descriptor in PATTERNS and PATTERNS[method.descriptor].oriented
        has_passes = oriented and self.estimator == PROSAC
        if self.effort not in (None, "fast") and not has_passes:
            raise InputError(
                f"`effort` {self.effort} needs an oriented ILBP descriptor and the estimator {PROSAC}, "
                f"not {method.descriptor} and {self.estimator}; leave it out or choose fast"
            )
        return self.effort or ("normal" if has_passes else "fast")
