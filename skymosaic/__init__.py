"""skymosaic: turns overlapping UAV images into one mosaic."""

from __future__ import annotations

import importlib
import time
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from golden_model.config import Config
    from skymosaic.imagery.key_frames import select_key_frames
    from skymosaic.mosaicking.api import mosaic, mosaics
    from skymosaic.mosaicking.live.mosaic import LiveMosaic
    from skymosaic.mosaicking.live.update import LiveUpdate
    from skymosaic.mosaicking.options import LiveOptions, MosaicOptions
    from skymosaic.mosaicking.pairs import register_pairs, table_of_pairs
    from skymosaic.mosaicking.result import Mosaic
    from skymosaic.registration.extraction import Features, extract
    from skymosaic.registration.options import FeatureOptions, RegistrationOptions
    from skymosaic.registration.pair import Pair
    from skymosaic.registration.register import register
    from skymosaic.tracking.template import Roi
    from skymosaic.tracking.tracker import TrackedFrame, Tracker, TrackerOptions

__all__ = [
    "Config",
    "FeatureOptions",
    "Features",
    "LiveMosaic",
    "LiveOptions",
    "LiveUpdate",
    "Mosaic",
    "MosaicOptions",
    "Pair",
    "RegistrationOptions",
    "Roi",
    "TrackedFrame",
    "Tracker",
    "TrackerOptions",
    "extract",
    "mosaic",
    "mosaics",
    "register",
    "register_pairs",
    "select_key_frames",
    "table_of_pairs",
]
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


def __getattr__(name: str) -> object:
    """Import the public names when they are first used: ``skymosaic --help`` needs neither NumPy nor OpenCV."""
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(_MODULES[name]), name)


def __dir__() -> list[str]:
    """What completion offers, and nothing else."""
    return __all__
