"""skymosaic: turns overlapping UAV images into one mosaic."""

from __future__ import annotations

import importlib
import time
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from skymosaic.extraction import Features, extract
    from skymosaic.mosaic_options import MosaicOptions
    from skymosaic.mosaic_result import Mosaic
    from skymosaic.mosaicing import mosaic, mosaics
    from skymosaic.pair import Pair
    from skymosaic.registration import register

__all__ = ["Features", "Mosaic", "MosaicOptions", "Pair", "extract", "mosaic", "mosaics", "register"]
IMPORTED_S = time.perf_counter()
"""When the program began, for times that add up to its wall time."""
_MODULES = {
    "Features": "extraction",
    "Mosaic": "mosaic_result",
    "MosaicOptions": "mosaic_options",
    "Pair": "pair",
    "extract": "extraction",
    "register": "registration",
}


def __getattr__(name: str) -> object:
    """Import the public names when they are first used: ``skymosaic --help`` needs neither NumPy nor OpenCV."""
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f"skymosaic.{_MODULES.get(name, 'mosaicing')}"), name)
