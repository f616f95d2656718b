"""Draws the pictures of the documentation's page about the algorithm, from the built-in pair.

python bench/doc_pictures.py [FOLDER]
"""

from __future__ import annotations

import io
import sys
from pathlib import Path

import cv2
import numpy as np
from matplotlib.figure import Figure

from golden_model.arrays import Pixels
from golden_model.feature.ilbp import ILBP_128
from sim.scene import make_pair
from skymosaic import Pair, mosaic
from skymosaic.reports import figures
from skymosaic.reports.fuzzy_plots import draw_system
from skymosaic.reports.fuzzy_systems import PLOTTED_SYSTEMS

SEED = 9
QUALITY = 70
DRAWN_BYTE = 0
"""The byte of the descriptor whose eight comparisons are drawn."""


def save(folder: Path, name: str, pixels: Pixels) -> None:
    """Save a picture as ``algorithm-NAME.webp``."""
    cv2.imwrite(str(folder / f"algorithm-{name}.webp"), pixels, [cv2.IMWRITE_WEBP_QUALITY, QUALITY])


def decoded(png: bytes) -> Pixels:
    """The pixels of a PNG."""
    return np.asarray(cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_COLOR), dtype=np.uint8)


def rings() -> Pixels:
    """The pixels that the descriptor compares, and the eight comparisons of one byte."""
    figure = Figure(figsize=(5, 5), layout="constrained")
    plot = figure.subplots()
    for offsets in ILBP_128.offsets:
        plot.scatter(*zip(*offsets, strict=True), s=26, zorder=3)
    a, b, k = ILBP_128.comparisons[DRAWN_BYTE]
    for bit in range(8):
        start = ILBP_128.offsets[a][2 * bit]
        end = ILBP_128.offsets[b][(2 * bit + k) % ILBP_128.angles]
        plot.annotate("", end, start, arrowprops={"arrowstyle": "<->", "color": "#0f6e78", "linewidth": 1.4})
    plot.set(aspect="equal", xlabel="x, px", ylabel="y, px (down)")
    plot.invert_yaxis()
    plot.grid(alpha=0.3)
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=110)
    return decoded(buffer.getvalue())


def outlined(pair: Pair, image: Pixels) -> Pixels:
    """The mosaic with the outline of the left photograph, whose place the homography gives."""
    result = image.copy()
    assert pair.homography is not None
    width, height = pair.left.size
    frame = np.array([[(0, 0), (width, 0), (width, height), (0, height)]], dtype=np.float64)
    placed = cv2.perspectiveTransform(frame, pair.homography)
    # The canvas starts where the left photograph's corners reach farthest to the left and up.
    placed -= np.minimum(placed.min(axis=1), 0)
    cv2.polylines(result, [np.round(placed).astype(np.int32)], True, (255, 255, 255), 2, cv2.LINE_AA)
    return result


def main(folder: Path) -> None:
    """Draw every picture."""
    result = mosaic(list(make_pair(seed=SEED).images))
    pair = result.pairs[0]
    save(folder, "corners", figures.draw_corners(pair.working[0], pair.features[0]))
    save(folder, "rings", rings())
    save(folder, "matches", figures.draw_matches(pair))
    save(folder, "rules", decoded(draw_system(PLOTTED_SYSTEMS["aerial"])))
    save(folder, "mosaic", outlined(pair, result.image))


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path("docs/images"))
