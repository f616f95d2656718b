"""skymosaic: turns overlapping UAV images into one mosaic."""

from __future__ import annotations

import importlib
import time
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from skymosaic.mosaic_options import MosaicOptions
    from skymosaic.mosaicing import Mosaic, mosaic, mosaics
    from skymosaic.registration import Pair, register

__all__ = ["Mosaic", "MosaicOptions", "Pair", "mosaic", "mosaics", "register"]
IMPORTED_S = time.perf_counter()
"""When the program began, for times that add up to its wall time."""
_MODULES = {"MosaicOptions": "mosaic_options", "Pair": "registration", "register": "registration"}


def __getattr__(name: str) -> object:
    """Import the public names when they are first used: ``skymosaic --help`` needs neither NumPy nor OpenCV."""
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f"skymosaic.{_MODULES.get(name, 'mosaicing')}"), name)
