"""Matches that somebody else has found: another library, or a person who has clicked points."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike

from golden_model.arrays import Array, Matrix, Points, Records
from golden_model.formats import WEIGHT
from golden_model.matching.matcher import pair_features
from skymosaic.common.errors import InputError
from skymosaic.features.positions import raw_positions
from skymosaic.geometry.homography import apply
from skymosaic.geometry.prosac import MIN_INLIERS
from skymosaic.imagery.lens import Lens

Given = tuple[ArrayLike, ArrayLike] | tuple[ArrayLike, ArrayLike, ArrayLike]
"""Positions (N, 2) in the left and in the right photograph, upright, px, and weights (N,), 0 to 1; 1 without them."""
Side = tuple[tuple[int, int], Matrix, Lens]
"""Width and height of a photograph, its working pixels to its own, and the lens that it is straightened by."""
MAX_MATCHES = 1 << 16
"""Match records count in 16 bits."""


@dataclass(frozen=True, eq=False)
class GivenMatches:
    """Checked matches of two photographs."""

    points: tuple[Points, Points]
    weight: Array
    name: str
    """For messages."""

    @classmethod
    def read(cls, given: Any, name: str = "matches") -> Self:
        """Check what a user has given, see `Given`.

        Raises
        ------
        InputError
            For arrays of other shapes, what is no number, weights out of range, too few or too many matches.
        """
        try:
            left, right, *rest = (np.asarray(each, np.float64) for each in given)
            (weight,) = rest or [np.ones(len(left))]
            table = np.hstack((left.reshape(-1, 2), right.reshape(left.shape), weight.reshape(-1, 1)))
        except (TypeError, ValueError):
            raise InputError(f"{name}: give positions (N, 2), left and right, and perhaps weights (N,)") from None
        if wrong := int(np.count_nonzero(~np.isfinite(table).all(axis=1))):
            raise InputError(f"{name}: {wrong} of {len(table)} have NaN or infinity; leave them out")
        if not MIN_INLIERS <= len(table) <= MAX_MATCHES:
            raise InputError(f"{name}: {len(table)} matches; give at least {MIN_INLIERS}, at most {MAX_MATCHES}")
        if table[:, 4].min() < 0 or table[:, 4].max() > 1:
            raise InputError(f"{name}: weights {table[:, 4].min():g} to {table[:, 4].max():g}; they must be 0 to 1")
        return cls((table[:, :2], table[:, 2:4]), table[:, 4], name)

    def records(self, feature: np.dtype[np.void], sides: Sequence[Side]) -> tuple[tuple[Records, Records], Records]:
        """A feature record at each position, left and right, and match records, all in 1/16 working px.

        Raises
        ------
        InputError
            For positions outside a photograph.
        """
        left, right = (np.zeros(len(self.weight), feature) for _ in sides)
        for records, points, (size, to_original, lens) in zip((left, right), self.points, sides, strict=True):
            if outside := int(np.count_nonzero(((points < -0.5) | (points > np.subtract(size, 0.5))).any(axis=1))):
                whole = "{}x{} px".format(*size)
                raise InputError(f"{self.name}: {outside} of {len(points)} lie outside a photograph of {whole}")
            straight = apply(np.linalg.inv(to_original).astype(np.float64), lens.straighten_points(points, size))
            records["x"], records["y"] = raw_positions(straight).T
            records["index"] = np.arange(len(points))
        matches = pair_features(left, right, left["index"], right["index"])
        matches["weight"], matches["verdict"] = np.rint(self.weight * WEIGHT.max_raw), 1
        return (left, right), matches
