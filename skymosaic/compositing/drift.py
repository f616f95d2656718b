"""Takes a drift of brightness over the map out of all tones.

Light that stays with the sun or the ground, under an automatic exposure, differs from photograph to photograph as
ground does that grows brighter along the flight: overlaps cannot tell the two apart, and gains that follow them add up
over the map. A plane makes no step anywhere, so what of it photographs do not show themselves is divided out.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from golden_model.arrays import Array
from skymosaic.compositing.layer import Layer
from skymosaic.compositing.light import GRID
from skymosaic.compositing.tone import Tone
from skymosaic.compositing.warp import Canvas
from skymosaic.geometry.homography import apply

USUAL_DRIFT = 1.25
"""Brightness at one end of the map over that at the other which is left as it is."""
MIN_LENGTHS = 2.0
"""Length of a flight along its drift, in those of a photograph: neighbours see the edge of a wood along one of them, so
in shorter flights most may see no more than that.
"""
ROUNDS, MIN_DIFFERENCE = 20, 0.01
"""Rounds of reweighting towards the least absolute differences, so that most neighbours must share a slope; and the
logarithm below which differences weigh alike.
"""


def take_out_drift(
    thumbnails: Sequence[Layer], tones: Sequence[Tone], ends: NDArray[np.integer]
) -> tuple[list[Tone], float]:
    """Divide a drift out of tones; return also its ratio over the map, 1 for none. ``ends`` (2, N) are who overlaps.

    The drift is that of the gains, as far as the toned photographs grow brighter in the same direction: gains that
    undo a change of exposure make the map even and stay.
    """
    centres = np.array([apply(layer.transform, (np.array(layer.size) - 1.0) / 2) for layer in thumbnails])
    kept = np.array([np.log(t.gain).mean() + (0 if t.light is None else t.light.mean()) for t in tones])
    shown = kept + [np.log(max(layer.image.mean() - t.black, 1)) for layer, t in zip(thumbnails, tones, strict=True)]
    across = centres[ends[0]] - centres[ends[1]]
    of_gains, of_map = (_fit_slope(across, some[ends[0]] - some[ends[1]]) for some in (kept, shown))
    slope = of_gains * np.clip(float(of_map @ of_gains) / max(float(of_gains @ of_gains), 1e-12), 0, 1)
    at_centres = centres @ slope
    low, high = at_centres.min(), at_centres.max()
    lengths = [np.ptp(apply(layer.transform, Canvas(0, 0, *layer.size).corners) @ slope) for layer in thumbnails]
    if high - low < max(np.log(USUAL_DRIFT), MIN_LENGTHS * float(np.median(lengths))):
        return list(tones), 1.0
    x, y = np.meshgrid(np.linspace(0, 1, GRID[1]), np.linspace(0, 1, GRID[0]))
    evened = []
    for layer, tone in zip(thumbnails, tones, strict=True):
        nodes = apply(layer.transform, np.stack((x, y), axis=-1) * (np.array(layer.size) - 1))
        # Towards a horizon a plane has no bounds.
        drift = np.clip(np.nan_to_num(nodes @ slope), low, high)[..., None]
        evened.append(replace(tone, light=((0 if tone.light is None else tone.light) - drift).astype(np.float32)))
    return evened, float(np.exp(high - low))


def _fit_slope(across: Array, differences: Array) -> Array:
    """The slope (2,) of a plane whose differences between neighbours are least, by their absolute values."""
    weight, slope = np.ones(len(across)), np.zeros(2)
    # A single line of photographs says nothing about the direction across it.
    little = 1e-3 * np.square(across).sum() / len(across) * np.eye(2)
    for _ in range(ROUNDS):
        normal = (weight[:, None] * across).T @ across / weight.sum() + little
        slope = np.linalg.solve(normal, (weight * differences) @ across / weight.sum())
        weight = 1 / np.maximum(np.abs(differences - across @ slope), MIN_DIFFERENCE)
    return slope
