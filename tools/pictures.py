"""The documentation's pictures of the algorithm and of further passes.

python -m tools.pictures algorithm
python -m tools.pictures passes
"""

import io
from pathlib import Path
from typing import Annotated

import cv2
import numpy as np
import typer
from matplotlib.figure import Figure

from bench.rendered_pairs import flat_pair, relief_pair
from bench.report import program
from golden_model.arrays import Matrix, Pixels
from golden_model.feature.ilbp import ILBP_128
from sim.scene import make_pair
from skymosaic import Pair, mosaic, register
from skymosaic.fuzzy.plots import draw_system
from skymosaic.fuzzy.plotted_systems import PLOTTED_SYSTEMS
from skymosaic.geometry.homography import apply
from skymosaic.reports import figures

app = program(__doc__)

PICTURES = Path(__file__).parents[1] / "docs" / "images"
SEED = 9
QUALITY = 70
DRAWN_BYTE = 0
"""The byte of the descriptor whose eight comparisons are drawn."""

Folder = Annotated[Path, typer.Option(help="Where the pictures are written.")]


@app.command()
def algorithm(folder: Folder = PICTURES) -> None:
    """Draw the pictures of the page about the algorithm, from the built-in pair."""
    result = mosaic(list(make_pair(seed=SEED).images))
    pair = result.pairs[0]
    pictures = {
        "corners": figures.draw_corners(pair.working[0], pair.features[0]),
        "rings": draw_rings(),
        "matches": figures.draw_matches(pair),
        "rules": decode(draw_system(PLOTTED_SYSTEMS["aerial"])),
        "mosaic": draw_outline(pair, result.image.astype(np.uint8)),
    }
    for name, pixels in pictures.items():
        save(folder / f"algorithm-{name}.webp", pixels)


def draw_rings() -> Pixels:
    """The pixels that the descriptor compares, and the eight comparisons of one byte."""
    figure = Figure(figsize=(5, 5), layout="constrained")
    plot = figure.subplots()
    for offsets in ILBP_128.offsets:
        x, y = zip(*offsets, strict=True)
        plot.scatter(x, y, s=26, zorder=3)
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
    return decode(buffer.getvalue())


def draw_outline(pair: Pair, image: Pixels) -> Pixels:
    """The mosaic with the outline of the left photograph, whose place the homography gives."""
    assert pair.homography is not None
    width, height = pair.left.size
    placed = apply(pair.homography, np.array([(0, 0), (width, 0), (width, height), (0, height)]))
    # The canvas starts where the left photograph's corners reach farthest to the left and up.
    placed -= np.minimum(placed.min(axis=0), 0)
    cv2.polylines(result := image.copy(), [np.rint(placed).astype(np.int32)], True, (255, 255, 255), 2, cv2.LINE_AA)
    return result


@app.command()
def passes(folder: Folder = PICTURES) -> None:
    """Draw what passes after the first one change: a steep view, a zoom, and ground with relief."""
    relief = relief_pair(25, 0.35, 4)
    rows = [
        draw_efforts("seen from 75 degrees", *flat_pair("tilt", 75, 0)[:2]),
        draw_efforts("five times as high", *flat_pair("zoom", 5, 0)[:2]),
        draw_efforts("relief", relief.left, relief.right),
    ]
    save(folder / "registration-passes.webp", np.concatenate(rows))


def draw_efforts(title: str, left: Pixels, right: Pixels) -> Pixels:
    """A pair, and how its overlap fits after one pass and by the default effort, side by side."""
    pictures = [(np.concatenate((left, right), axis=1), title)]
    passes = register(left, right, effort="fast"), register(left, right, effort="normal")
    for words, pair in zip(("one pass", "normal"), passes, strict=True):
        if pair.homography is None or pair.confidence is None:
            pictures.append((np.zeros_like(left), f"{words}: refused"))
        else:
            predicted = f"{words}: predicted error {pair.confidence.predicted_px:.1f} px"
            pictures.append((draw_overlap(left, right, pair.homography), predicted))
    halves = [cv2.resize(picture, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA) for picture, _ in pictures]
    titled = (figures.add_header(half, words) for half, (_, words) in zip(halves, pictures, strict=True))
    return np.concatenate([*titled], axis=1)


def draw_overlap(left: Pixels, right: Pixels, homography: Matrix) -> Pixels:
    """The gray left photograph in red and the right one, warped onto it, in cyan: gray where they agree."""
    width, height = left.shape[1], left.shape[0]
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    warped = cv2.warpPerspective(right, homography, (width, height), flags=flags)
    return np.asarray(cv2.merge((warped, warped, left)), dtype=np.uint8)


def save(path: Path, pixels: Pixels) -> None:
    """Write a picture as WebP."""
    cv2.imwrite(str(path), pixels, [cv2.IMWRITE_WEBP_QUALITY, QUALITY])


def decode(png: bytes) -> Pixels:
    """The pixels of a PNG."""
    return np.asarray(cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_COLOR), dtype=np.uint8)


if __name__ == "__main__":
    app()
