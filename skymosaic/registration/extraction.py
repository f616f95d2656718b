"""Features of one photograph, in its own pixels."""

import dataclasses
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Unpack

import numpy as np
from numpy.typing import NDArray

from golden_model.arrays import Array, Matrix, Pixels, Points, Records
from golden_model.config import Config
from golden_model.feature.orientation import SECTORS
from golden_model.text import one_line
from sim.backends.interface import Progress, silent
from skymosaic.features.methods import Method
from skymosaic.features.positions import feature_points
from skymosaic.geometry.homography import apply
from skymosaic.imagery.images import Photograph, load, reduce_for_front_end
from skymosaic.registration.options import FeatureKeywords, FeatureOptions
from skymosaic.registration.register import extract_within_capacity


@dataclass(frozen=True, repr=False)
class Features:
    """Features of one photograph.

    Attributes
    ----------
    photograph : Photograph
    points : ndarray of float64, shape (N, 2)
        Positions (x, y) in original pixels, pixel centres at integers.
    levels : ndarray of uint8, shape (N,)
        Pyramid level: 0 at full size, 1 at half size.
    angles : ndarray of float64, shape (N,)
        Orientation in radians, in steps of a sixteenth of a circle; 0 without orientation.
    descriptors : ndarray of uint8, shape (N, B)
        B bytes each; 8 bits per byte of a binary descriptor.
    records : structured array, shape (N,)
        From the front end (`golden_model.records.feature_record`), positions in 1/16 working px.
    to_original : ndarray of float64, shape (3, 3)
        Working pixels to original pixels.
    method : Method
        Detector and descriptor.
    config : Config
    """

    photograph: Photograph
    points: Points
    levels: NDArray[np.uint8]
    angles: Array
    descriptors: NDArray[np.uint8]
    records: Records
    to_original: Matrix
    method: Method
    config: Config

    def __len__(self) -> int:
        return len(self.records)

    def __repr__(self) -> str:
        """One line with the name, the count and the method."""
        method = f"{self.method.detector} with {self.method.descriptor}"
        return one_line(f"Features({self.photograph.name}: {len(self)} {method})")


def extract(
    image: str | Path | Pixels,
    options: FeatureOptions | None = None,
    *,
    progress: Progress = silent,
    **changes: Unpack[FeatureKeywords],
) -> Features:
    """Find and describe the features of one photograph.

    Parameters
    ----------
    image : path or ndarray of uint8, shape (H, W) or (H, W, 3) BGR
    options : FeatureOptions, optional
    progress : callable
        Receives lines about the first build of a simulation.
    **changes
        Single options by the names of `FeatureOptions`; they take precedence over ``options``.

    Raises
    ------
    skymosaic.errors.InputError
        For a photograph that cannot be used, an unknown name or an impossible combination.

    Examples
    --------
    >>> from sim.scene import make_pair
    >>> features = extract(make_pair(seed=5, size=(320, 240)).images[0])
    >>> features.points.shape == (len(features), 2)
    True
    >>> features.descriptors.shape[1]
    16
    """
    options = dataclasses.replace(options or FeatureOptions(), **changes)
    options.check()
    photograph = load(image, "image", keep_damaged=options.keeps_damaged)
    method, config = options.choose_method()
    working, to_original = reduce_for_front_end(photograph.pixels, options.working_width_px, photograph.name)
    (result,), config = extract_within_capacity(options.open_backend(method, progress), [working], config)
    records = result.features
    return Features(
        photograph=photograph,
        points=apply(to_original, feature_points(records)),
        levels=records["level"].astype(np.uint8),
        angles=records["sector"] * (math.tau / SECTORS),
        descriptors=records["descriptor"],
        records=records,
        to_original=to_original,
        method=method,
        config=config,
    )
