"""Judges a pair apart from a display: text that stands still while the ground moves."""

from dataclasses import replace

import numpy as np

from golden_model.arrays import Records
from skymosaic.features.contrast import find_shared
from skymosaic.features.positions import look_up, match_points
from skymosaic.geometry.ground import measure_ground
from skymosaic.geometry.homography import transfer_error
from skymosaic.registration.pair import Pair

DELIVER = "; `accept_poor` delivers it nevertheless"
STILL_MATCHES, STILL_PX, MOVED = 4, 1.0, 0.05
"""So many matches within so few pixels of where they were, where the homography says that the ground has moved by so
much of the longer side, show a display."""
MAX_DISPLAY, MAX_ON_DISPLAY = 0.5, 0.5
"""A homography with more of its inliers on a display is that of its text. What covers more is a sensor's pattern."""


def look_behind_display(pair: Pair, matches: Records, *, accept_poor: bool = False) -> Pair:
    """Judge a pair without what both images show at the same pixels, as text, if such ``matches`` stand still.

    It is refused where the homography rests on that: text of one corner may be that of another, too.
    """
    homography, sights = pair.working_homography, pair.sights
    if homography is None or sights[0].size != sights[1].size:
        return pair
    left, right = match_points(matches[matches["verdict"] == 1])
    still = np.linalg.norm(left - right, axis=1) <= STILL_PX
    away_px = transfer_error(homography, left[still], right[still])
    behind_still = np.count_nonzero(away_px > MOVED * max(sights[0].size))
    if not behind_still:
        return pair
    moving = find_shared(*pair.working)
    left_on, right_on = (look_up(points, moving) for points in match_points(pair.inliers))
    on_display = np.count_nonzero(left_on & right_on)
    if np.mean(moving) < MAX_DISPLAY and on_display > MAX_ON_DISPLAY * len(pair.inliers) and not accept_poor:
        return pair.refused(f"{on_display} inliers lie on what both show at the same pixels{DELIVER}")
    if behind_still < STILL_MATCHES:
        return pair
    masks = [np.where(moving, np.uint8(0), np.uint8(255) if mask is None else mask) for mask in pair.visible]
    behind = replace(pair, visible=(masks[0], masks[1]))
    return behind if measure_ground(*behind.sights, homography).wins else pair
