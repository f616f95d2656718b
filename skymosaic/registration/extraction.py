"""Features of one photograph, in its own pixels."""

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Unpack

import cv2
import numpy as np
from numpy.typing import NDArray

from golden_model.arrays import Array, Matrix, Pixels, Points, Records
from golden_model.config import MAX_THRESHOLD, Config
from golden_model.feature.orientation import SECTORS
from golden_model.pixel.gray import to_gray
from golden_model.records import Cause
from golden_model.text import one_line
from sim.backends.interface import Backend, FrameResult, Progress, silent
from skymosaic.common.errors import InputError
from skymosaic.common.options import choose_options, list_options
from skymosaic.features.frames import DescribedImage
from skymosaic.features.methods import Method
from skymosaic.features.positions import feature_points
from skymosaic.geometry.homography import apply
from skymosaic.imagery.images import Photograph, load, reduce_for_front_end
from skymosaic.imagery.notebook import describe_in_html
from skymosaic.registration.options import FeatureOptions

if TYPE_CHECKING:
    from skymosaic.keywords import FeatureKeywords


MARK_COLOR = (0, 200, 0)


@dataclass(frozen=True, repr=False, eq=False)
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
        B bytes each.
    records : structured array, shape (N,)
        From the front end (`golden_model.records.feature_record`), positions in 1/16 working px.
    working : DescribedImage
        The image that the front end processed; it keeps the features of further passes for the pairs that need them.
    working_width_px : int
        The width that was asked for.
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
    working: DescribedImage
    working_width_px: int
    to_original: Matrix
    method: Method
    config: Config

    def __len__(self) -> int:
        return len(self.records)

    def _repr_html_(self) -> str:
        """The photograph with its features, for notebooks."""
        picture = cv2.cvtColor(to_gray(self.working.image), cv2.COLOR_GRAY2BGR)
        corners = [cv2.KeyPoint(x, y, 1) for x, y in feature_points(self.records).astype(float).tolist()]
        drawn = cv2.drawKeypoints(picture, corners, picture, MARK_COLOR)
        return describe_in_html(repr(self), np.asarray(drawn, dtype=np.uint8))

    def __repr__(self) -> str:
        """One line with the name, the count and the method."""
        method = f"{self.method.detector} with {self.method.descriptor}"
        return one_line(f"Features({self.photograph.name}: {len(self)} {method})")


@list_options
def extract(
    image: str | Path | Pixels,
    options: FeatureOptions | None = None,
    *,
    progress: Progress = silent,
    **changes: "Unpack[FeatureKeywords]",
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
    skymosaic.common.errors.InputError
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
    options = choose_options(FeatureOptions, options, changes)
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
        working=DescribedImage(working),
        working_width_px=options.working_width_px,
        to_original=to_original,
        method=method,
        config=config,
    )


def extract_within_capacity(
    front_end: Backend, frames: Sequence[Pixels], config: Config
) -> tuple[list[FrameResult], Config]:
    """Run the front end; if a frame has more corners than a feature bank holds, raise the threshold for all frames.

    Only a configuration without cell selection can exceed the capacity. The thesis raises its threshold in
    the same way (section II.2.1.2); we double it until every frame fits.
    """
    while True:
        results = front_end.run(frames, config)
        threshold, limit = config.front_end.threshold, MAX_THRESHOLD[config.front_end.detector]
        too_many = any(int(result.status["causes"]) & Cause.TOO_MANY_FEATURES for result in results)
        if not too_many or threshold == limit:
            return results, config
        raised = dataclasses.replace(config.front_end, threshold=min(2 * threshold, limit))
        config = dataclasses.replace(config, front_end=raised)


def share_features(side: str | Path | Pixels | Features, options: FeatureOptions, progress: Progress) -> Features:
    """The features of one side, extracted where they are not given.

    Raises
    ------
    InputError
        As `register`.
    """
    method, config = options.choose_method()
    if not method.on_accelerator:
        raise InputError(f"features of {method.descriptor} are not shared between pairs; give the photographs")
    if not isinstance(side, Features):
        return extract(side, options, progress=progress)
    # A threshold that was raised for the photograph is not another configuration.
    front_end = dataclasses.replace(side.config.front_end, threshold=config.front_end.threshold)
    if side.method != method or front_end != config.front_end or side.working_width_px != options.working_width_px:
        raise InputError(
            f"{side.photograph.name}: its features were extracted with other options; extract them with the same "
            "preset, config, detector, descriptor and working width"
        )
    return side
