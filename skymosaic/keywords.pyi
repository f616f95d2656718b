# Written by `python -m tools.keywords`.
# fmt: off
# ruff: noqa
# mypy: disable-error-code="attr-defined"
from typing import TypedDict

from skymosaic.mosaicking.options import BaseMap
from skymosaic.mosaicking.options import Blending
from skymosaic.mosaicking.options import Boundary
from skymosaic.mosaicking.options import Candidate
from skymosaic.mosaicking.options import ControlPoints
from skymosaic.mosaicking.options import Given
from skymosaic.mosaicking.options import Lens
from skymosaic.mosaicking.options import LiveEstimator
from skymosaic.mosaicking.options import Mapping
from skymosaic.mosaicking.options import Mosaic
from skymosaic.mosaicking.options import Path
from skymosaic.mosaicking.options import Positions
from skymosaic.mosaicking.options import Warp
from skymosaic.registration.options import Backend
from skymosaic.registration.options import BackendName
from skymosaic.registration.options import Config
from skymosaic.registration.options import Damaged
from skymosaic.registration.options import Descriptor
from skymosaic.registration.options import Detector
from skymosaic.registration.options import Effort
from skymosaic.registration.options import Estimator
from skymosaic.registration.options import MatchRules
from skymosaic.registration.options import Preset
from skymosaic.registration.options import RuleBase

class FeatureKeywords(TypedDict, total=False):
    backend: BackendName | Backend
    address: str | None
    preset: Preset
    config: Config | None
    rules: RuleBase | MatchRules | None
    working_width_px: int
    damaged: Damaged
    detector: Detector | None
    descriptor: Descriptor | None

class RegistrationKeywords(TypedDict, total=False):
    backend: BackendName | Backend
    address: str | None
    preset: Preset
    config: Config | None
    rules: RuleBase | MatchRules | None
    working_width_px: int
    damaged: Damaged
    detector: Detector | None
    descriptor: Descriptor | None
    seed: int
    estimator: Estimator
    effort: Effort | None
    accept_poor: bool

class MosaicKeywords(TypedDict, total=False):
    backend: BackendName | Backend
    address: str | None
    preset: Preset
    config: Config | None
    rules: RuleBase | MatchRules | None
    working_width_px: int
    damaged: Damaged
    detector: Detector | None
    descriptor: Descriptor | None
    seed: int
    estimator: Estimator
    effort: Effort | None
    accept_poor: bool
    recursive: bool
    lens: Lens | None
    control_points: ControlPoints | None
    positions: Positions | None
    onto: BaseMap | None
    boundary: Boundary | None
    keep_all: bool
    scheduler: str | None
    cache: Path | None
    matches: Mapping[Candidate, Given] | None
    band: str | None
    scale: float
    canvas_limit_px: int | None
    blending: Blending | None
    warp: Warp
    all_groups: bool
    gsd_m: float | None
    memory_bytes: int
    repeat: Mosaic | None

class LiveKeywords(TypedDict, total=False):
    backend: BackendName | Backend
    address: str | None
    preset: Preset
    config: Config | None
    rules: RuleBase | MatchRules | None
    working_width_px: int
    damaged: Damaged
    seed: int
    recursive: bool
    band: str | None
    scale: float
    canvas_limit_px: int | None
    estimator: LiveEstimator

class TrackerKeywords(TypedDict, total=False):
    backend: BackendName | Backend
    address: str | None
    preset: Preset
    config: Config | None
    rules: RuleBase | MatchRules | None
    seed: int
