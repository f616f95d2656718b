"""A registered pair as workers return it and the page shows it: records and numbers, no pixels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from golden_model.arrays import Array, Mask, Records
from golden_model.config import Config
from skymosaic.features.descriptors import WINDOWS_PX
from skymosaic.features.matchers import GOOD_MATCH_ABOVE
from skymosaic.features.methods import Method
from skymosaic.features.positions import match_points
from skymosaic.geometry.homography import transfer_error
from skymosaic.registration.pair import Pair
from skymosaic.reports.pair import collect_pair_numbers

Size = tuple[int, int]


@dataclass(frozen=True)
class PairView:
    """A registered pair without its pixels.

    Attributes
    ----------
    names : (str, str)
        Names of left and right.
    working_sizes : (Size, Size)
    features : tuple of structured arrays
        Feature records of left and right, in 1/16 working px.
    matches : structured array
        Match records of all mutual matches.
    residual_px : (M,) float64 or None
        Distance of each match from the homography in the right working image; None if there is no homography.
    inlier : (M,) bool
        Kept, and within 2 px of the homography.
    method : Method
        Detector, descriptor and matcher.
    config : Config
    numbers : dict
        As `skymosaic.reports.pair.collect_pair_numbers` returns them.
    """

    names: tuple[str, str]
    working_sizes: tuple[Size, Size]
    features: tuple[Records, Records]
    matches: Records
    residual_px: Array | None
    inlier: Mask
    method: Method
    config: Config
    numbers: dict[str, Any]

    @classmethod
    def from_pair(cls, pair: Pair) -> PairView:
        """Keep what the page shows of a pair."""
        # Measured on all matches, also on those rejected, to show how far off they are.
        residual = None
        if pair.working_homography is not None:
            left, right = match_points(pair.matches)
            residual = transfer_error(pair.working_homography, left, right)
        sizes = tuple((image.shape[1], image.shape[0]) for image in pair.working)
        return cls(
            names=(pair.left.name, pair.right.name),
            working_sizes=(sizes[0], sizes[1]),
            features=pair.features,
            matches=pair.matches,
            residual_px=residual,
            inlier=np.isin(pair.matches["left_index"], pair.inliers["left_index"]),
            method=pair.method,
            config=pair.config,
            numbers=collect_pair_numbers(pair),
        )

    @property
    def kept(self) -> Mask:
        """Which matches the fuzzy stage kept, (M,)."""
        return np.asarray(self.matches["verdict"] == 1)

    @property
    def rule_names(self) -> Sequence[str]:
        """The rule in words for each value of a match's ``rule``."""
        return self.method.rule_names(self.config)

    @property
    def keep_above(self) -> int:
        """The weight, UQ0.8, that a match must exceed to be kept."""
        return GOOD_MATCH_ABOVE if self.method.descriptor in WINDOWS_PX else self.config.matcher.keep_above
