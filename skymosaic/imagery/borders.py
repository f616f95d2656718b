"""Finds the border that a stabiliser leaves where it has moved a frame of a video: black or white, and no ground."""

import cv2
import numpy as np

from golden_model.arrays import Pixels

MAX_RANGE = 8
"""Levels from black, or from white, that a codec leaves in a border."""
SMEARED_PX = 4
"""What is so near to a border is mixed with it, by the stabiliser and the codec; its specks in the border are no
larger."""
MIN_SHARE = 0.001
"""Share of a frame that is worth a mask."""
MAX_INSIDE = 0.3
"""Share of a border that lies in the convex hull of the rest: a moved frame has straight sides; night, snow and glare
have none.
"""


def find_shown(frame: Pixels) -> Pixels | None:
    """Find the part of a frame, (H, W, 3), inside such a border: (H, W), 255 inside, else 0; None without a border."""
    around = np.ones((2 * SMEARED_PX + 1,) * 2, np.uint8)
    for blank in (frame.max(axis=2) <= MAX_RANGE, frame.min(axis=2) >= 255 - MAX_RANGE):
        # A ring around the frame joins the parts of the border.
        ringed = cv2.copyMakeBorder(blank.astype(np.uint8), 1, 1, 1, 1, cv2.BORDER_CONSTANT, value=1)
        cv2.floodFill(ringed, None, (0, 0), (2,))
        shown = cv2.morphologyEx((ringed[1:-1, 1:-1] < 2).astype(np.uint8), cv2.MORPH_OPEN, around)
        border_px = shown.size - int(shown.sum())
        if not MIN_SHARE * shown.size <= border_px < shown.size:
            continue
        hull = cv2.fillConvexPoly(np.zeros_like(shown), cv2.convexHull(cv2.findNonZero(shown)), (1,))
        if int(hull.sum()) - int(shown.sum()) <= MAX_INSIDE * border_px:
            return np.asarray(255 * cv2.erode(shown, around), dtype=np.uint8)
    return None
