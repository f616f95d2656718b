"""Draws the matches of two photographs; needs matplotlib, which the extra ``plots`` installs."""

import cv2
import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from golden_model.arrays import Array, Pixels, Points

# Between the photographs, as a share of the left one's width.
GAP = 0.02
HEIGHT_IN = 5.0
MAX_WIDTH_IN = 16.0


def draw_matches(images: tuple[Pixels, Pixels], left: Points, right: Points, weights: Array, *, title: str) -> Figure:
    """Draw two photographs beside each other, and a line for each match.

    Parameters
    ----------
    images : tuple of ndarray of uint8
        Gray or BGR; they need not be of one size.
    left, right : ndarray, shape (N, 2)
        Matched points, px of the photographs.
    weights : ndarray, shape (N,)
        0 to 1, shown as colours.
    title : str
    """
    (left_height, left_width), (right_height, right_width) = (image.shape[:2] for image in images)
    offset = np.array([left_width * (1 + GAP), 0.0])
    aspect = (offset[0] + right_width) / max(left_height, right_height)
    figure = Figure(figsize=(min(HEIGHT_IN * aspect, MAX_WIDTH_IN), HEIGHT_IN + 1), layout="constrained")
    plot = figure.subplots()
    for image, x_px in zip(images, (0.0, offset[0]), strict=True):
        height, width = image.shape[:2]
        shown = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_BGR2RGB)
        extent = (x_px - 0.5, x_px + width - 0.5, height - 0.5, -0.5)
        plot.imshow(shown, cmap="gray", vmin=0, vmax=255, extent=extent)
    lines = LineCollection(list(np.stack((left, right + offset), axis=1)), cmap="viridis", linewidths=0.7)
    lines.set_array(weights)
    lines.set_clim(0, 1)
    plot.add_collection(lines)
    plot.set(xlim=(-0.5, offset[0] + right_width - 0.5), ylim=(max(left_height, right_height) - 0.5, -0.5))
    plot.set_axis_off()
    # Names of files may hold dollar signs, which are not formulas.
    plot.set_title(title, wrap=True, parse_math=False)
    figure.colorbar(lines, ax=plot, label="weight of the match", shrink=0.8)
    return figure
