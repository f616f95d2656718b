"""skymosaic: turns overlapping UAV images into one mosaic."""

from __future__ import annotations

import importlib
import time
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from skymosaic.mosaicking.api import mosaic, mosaics
    from skymosaic.mosaicking.options import MosaicOptions
    from skymosaic.mosaicking.result import Mosaic
    from skymosaic.registration.extraction import Features, extract
    from skymosaic.registration.options import FeatureOptions, RegistrationOptions
    from skymosaic.registration.pair import Pair
    from skymosaic.registration.register import register

__all__ = [
    "FeatureOptions",
    "Features",
    "Mosaic",
    "MosaicOptions",
    "Pair",
    "RegistrationOptions",
    "extract",
    "mosaic",
    "mosaics",
    "register",
]
IMPORTED_S = time.perf_counter()
"""When the program began, for times that add up to its wall time."""
_MODULES = {
    "FeatureOptions": "registration.options",
    "Features": "registration.extraction",
    "Mosaic": "mosaicking.result",
    "MosaicOptions": "mosaicking.options",
    "Pair": "registration.pair",
    "RegistrationOptions": "registration.options",
    "extract": "registration.extraction",
    "mosaic": "mosaicking.api",
    "mosaics": "mosaicking.api",
    "register": "registration.register",
}


def __getattr__(name: str) -> object:
    """Import the public names when they are first used: ``skymosaic --help`` needs neither NumPy nor OpenCV."""
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f"skymosaic.{_MODULES[name]}"), name)
