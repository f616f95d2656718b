"""skymosaic: turns overlapping UAV images into one mosaic."""

from __future__ import annotations

import importlib
import time
from typing import TYPE_CHECKING

# `as` tells type checkers that a name is meant to be imported from here.
if TYPE_CHECKING:
    from golden_model.config import Config as Config
    from skymosaic.imagery.key_frames import select_key_frames as select_key_frames
    from skymosaic.mosaicking.api import mosaic as mosaic
    from skymosaic.mosaicking.api import mosaics as mosaics
    from skymosaic.mosaicking.live.mosaic import LiveMosaic as LiveMosaic
    from skymosaic.mosaicking.live.update import LiveUpdate as LiveUpdate
    from skymosaic.mosaicking.options import LiveOptions as LiveOptions
    from skymosaic.mosaicking.options import MosaicOptions as MosaicOptions
    from skymosaic.mosaicking.pairs import register_pairs as register_pairs
    from skymosaic.mosaicking.pairs import table_of_pairs as table_of_pairs
    from skymosaic.mosaicking.result import Mosaic as Mosaic
    from skymosaic.registration.extraction import Features as Features
    from skymosaic.registration.extraction import extract as extract
    from skymosaic.registration.options import FeatureOptions as FeatureOptions
    from skymosaic.registration.options import RegistrationOptions as RegistrationOptions
    from skymosaic.registration.pair import Pair as Pair
    from skymosaic.registration.register import register as register
    from skymosaic.tracking.template import Roi as Roi
    from skymosaic.tracking.tracker import TrackedFrame as TrackedFrame
    from skymosaic.tracking.tracker import Tracker as Tracker
    from skymosaic.tracking.tracker import TrackerOptions as TrackerOptions

IMPORTED_S = time.perf_counter()
"""When the program began, for times that add up to its wall time."""
_MODULES = {
    "Config": "golden_model.config",
    "FeatureOptions": "skymosaic.registration.options",
    "Features": "skymosaic.registration.extraction",
    "LiveMosaic": "skymosaic.mosaicking.live.mosaic",
    "LiveOptions": "skymosaic.mosaicking.options",
    "LiveUpdate": "skymosaic.mosaicking.live.update",
    "Mosaic": "skymosaic.mosaicking.result",
    "MosaicOptions": "skymosaic.mosaicking.options",
    "Pair": "skymosaic.registration.pair",
    "RegistrationOptions": "skymosaic.registration.options",
    "Roi": "skymosaic.tracking.template",
    "TrackedFrame": "skymosaic.tracking.tracker",
    "Tracker": "skymosaic.tracking.tracker",
    "TrackerOptions": "skymosaic.tracking.tracker",
    "extract": "skymosaic.registration.extraction",
    "mosaic": "skymosaic.mosaicking.api",
    "mosaics": "skymosaic.mosaicking.api",
    "register": "skymosaic.registration.register",
    "register_pairs": "skymosaic.mosaicking.pairs",
    "select_key_frames": "skymosaic.imagery.key_frames",
    "table_of_pairs": "skymosaic.mosaicking.pairs",
}
__all__ = list(_MODULES)


def __getattr__(name: str) -> object:
    """Import the public names when they are first used: ``skymosaic --help`` needs neither NumPy nor OpenCV."""
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(_MODULES[name]), name)


def __dir__() -> list[str]:
    """What completion offers, and nothing else."""
    return __all__
