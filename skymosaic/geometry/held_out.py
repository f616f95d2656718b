"""Compares homographies by points that had no part in their fit.

The fields of a chessboard over the left image take turns: a homography is fitted again to the points outside the
fields of one colour, and judged by those inside. All points of a field together have one vote, because a few textured
places must not decide alone.
"""

import numpy as np

from golden_model.arrays import Matrix, Points
from skymosaic.geometry.homography import DegenerateError, transfer_error
from skymosaic.geometry.prosac import INLIER_PX
from skymosaic.geometry.refinement import refine_robustly

FIELD_PX = 64.0
MIN_GAIN = 0.05
"""A smaller difference is noise: taken for a gain, it made a public pair worse by 0.8 px."""


def held_out_agreement(homography: Matrix, fitted: tuple[Points, Points], judges: tuple[Points, Points]) -> float:
    """How many fields agree with fits that none of their points had a part in.

    Each fit starts at the homography, and is made to some of the points ``fitted``, left and right; ``judges`` are
    other points, of which some may be wrong. A field counts 1 if its points have no error, and 0 if all are 2 px off or
    more, or if the points outside the fields of its colour determine no homography.
    """
    agreement = np.zeros(len(judges[0]))
    colours, fitted_colours = (np.floor(left / FIELD_PX).sum(axis=1) % 2 for left, _ in (judges, fitted))
    for colour in (0, 1):
        held_out, others = colours == colour, fitted_colours != colour
        try:
            fit = refine_robustly(homography, fitted[0][others], fitted[1][others])
        except DegenerateError:
            continue
        error_px = transfer_error(fit, judges[0][held_out], judges[1][held_out])
        agreement[held_out] = np.maximum(0, 1 - (error_px / INLIER_PX) ** 2)
    _, field, count = np.unique(np.floor(judges[0] / FIELD_PX), axis=0, return_inverse=True, return_counts=True)
    return float((agreement / count[field.ravel()]).sum())


def clearly_better(agreement: float, other: float) -> bool:
    """Whether one agreement exceeds another by more than noise."""
    return agreement > (1 + MIN_GAIN) * other
