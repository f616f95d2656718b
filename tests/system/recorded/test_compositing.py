"""Mosaics of photographs that differ in exposure, light, sharpness and shape, held against recorded ones."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from skymosaic.compositing.blend import Blending, blend_layers
from skymosaic.compositing.exposure import estimate_levels, estimate_tones, measure_toned_range
from skymosaic.compositing.layer import Layer
from skymosaic.compositing.mesh import Frame, Ties, fit_meshes
from skymosaic.compositing.seams import find_allowed, find_seams
from skymosaic.compositing.tone import Tone
from skymosaic.compositing.warp import enclosing
from skymosaic.geometry.homography import apply
from skymosaic.imagery.depth import ValueRange
from tests.system.recorded.rows import HEIGHT_PX, WIDTH_PX, check_picture, check_recorded, view

SIZE_PX = WIDTH_PX, HEIGHT_PX
EXPOSED = {1: (0.8, 0.85, 0.9), 2: (1.1, 1.1, 1.1), 3: (0.7, 0.7, 0.72), 5: (1.3, 1.25, 1.2)}


def layers(dtype: type = np.uint8, scale: float = 1.0, black: float = 0.0) -> list[Layer]:
    """Nine photographs: two below a cloud, one blurred, one with a masked corner, and of one only the nearer part."""
    made, mask, (row, column) = [], np.full(SIZE_PX[::-1], 255, np.uint8), np.mgrid[:HEIGHT_PX, :WIDTH_PX]
    mask[190:, :100] = 0
    for number in range(9):
        picture, place = view(
            160 + 200 * (number % 3), 120 + 160 * (number // 3), 0.07 * number - 0.3, 1, -6e-5 * number
        )
        cloud = 0.25 * np.exp(-(((column - 80 * number % WIDTH_PX) / 80.0) ** 2)) if number in (4, 7) else 0.0 * column
        falls = 0.3 * ((row - HEIGHT_PX / 2) ** 2 + (column - WIDTH_PX / 2) ** 2) / 200**2
        picture = picture * np.exp(-falls - cloud)[..., None] * EXPOSED.get(number, (1.0, 1.0, 1.0))
        picture = cv2.GaussianBlur(picture, (0, 0), 2) if number == 6 else picture
        image = np.clip(np.rint(picture * scale + black), 0, np.iinfo(dtype).max).astype(dtype)
        favour, least = 1e-3 if number == 6 else 1.0, 0.92 if number == 8 else 0.0
        made.append(Layer(image, place, visible=mask if number == 2 else None, favour=favour, least_nearness=least))
    return made


def bent(given: list[Layer]) -> list[Layer]:
    """The same with meshes, by matches of neighbours over ground that rises in the middle; every sixth one is wrong."""
    frames = {number: Frame(layer.size, layer.transform) for number, layer in enumerate(given)}
    rng, ties = np.random.default_rng(2), []
    for left, right in ((n, n + step) for n in range(8) for step in (1, 3) if n + step < 9 and (n % 3, step) != (2, 1)):
        points = rng.uniform((0, 0), (WIDTH_PX - 1, HEIGHT_PX - 1), (400, 2))
        ground = apply(given[left].transform, points)
        rise = 4 * np.exp(-((ground - (360, 280)) ** 2).sum(axis=1, keepdims=True) / 240**2) * (right - left)
        seen = apply(np.asarray(np.linalg.inv(given[right].transform), np.float64), ground) + rise * (1.0, -0.5)
        seen[::6] += rng.uniform(-60, 60, seen[::6].shape)
        inside = ((seen >= 0) & (seen < SIZE_PX)).all(axis=1)
        ties.append(Ties(left, right, points[inside], seen[inside]))
    meshes, (count, plain, bent) = fit_meshes(frames, ties, [1, 4, 5])
    shares = plain / count, bent / count
    check_recorded("meshes", [*shares, *(x for mesh in meshes.values() for x in mesh.nodes_px[::6, ::8].ravel())], 0.01)
    return [replace(layer, mesh=meshes.get(number)) for number, layer in enumerate(given)]


def check_blended(name: str, given: list[Layer], method: Blending, unit: float = 1.0) -> None:
    picture, owner = blend_layers(given, enclosing([each.footprint for each in given]), method=method)
    check_picture(name, picture / unit, owner >= 0)


def toned(given: list[Layer], tones: list[Tone], values: ValueRange | None = None) -> list[Layer]:
    equal = [replace(layer, tone=tone) for layer, tone in zip(given, tones, strict=True)]
    seams = find_seams(equal, find_allowed(equal).values(), 1.0, values)
    return [replace(layer, seam=seam) for layer, seam in zip(equal, seams, strict=True)]


@pytest.mark.parametrize("method", ["average", "distance", "multiband"])
def test_photographs_as_they_are(method: Blending) -> None:
    check_blended(method, layers(), method)


def test_photographs_of_eight_bits() -> None:
    tones, _ = estimate_tones(given := layers())
    light = [0 if tone.light is None else tone.light[::4, ::3, 1] for tone in tones]
    shading = 0 if tones[0].shading is None else tones[0].shading
    check_recorded("tones", np.hstack([np.ravel(x) for x in ([tone.gain for tone in tones], shading, *light)]), 0.002)
    check_blended("equal", toned(given, tones), "multiband")
    check_blended("bent", bent(given), "multiband")


def test_photographs_of_sixteen_bits() -> None:
    given = layers(np.uint16, 40.0, 3000.0)
    images = [each.image for each in given]
    black, white = estimate_levels(images, [3000.0, None, 2990.0])
    tones, _ = estimate_tones(given, black=black, white=white)
    values = measure_toned_range(tones, [each.reshape(-1, 3) for each in images], ValueRange(0.0, 1.0, deep=True))
    check_recorded("levels", [black, white, values.low, values.high], 2.0)
    check_blended("deep", toned(given, tones, values), "multiband", unit=40.0)
