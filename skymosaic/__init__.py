"""skymosaic: turns overlapping UAV images into one mosaic."""

from skymosaic.mosaicing import Mosaic, mosaic
from skymosaic.registration import Pair, register

__all__ = ["Mosaic", "Pair", "mosaic", "register"]
