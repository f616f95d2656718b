"""The pictures of a mosaic for the page: every tile is a part of the mosaic, and the finest are its own pixels."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest

from skymosaic.compositing.layer import SeamMask
from skymosaic.compositing.warp import Canvas
from skymosaic.flight.picture.composition import Composition, Placement
from skymosaic.imagery.lens import Lens
from skymosaic.imagery.parcel import Parcel
from skymosaic.imagery.photographs import Source
from skymosaic.panel.tasks import mosaic_picture
from skymosaic.panel.tasks.mosaic_picture import show_mosaic

MOSAIC = cv2.GaussianBlur(np.random.default_rng(2).integers(0, 256, (700, 1200, 3), np.uint8), (0, 0), 4)


def delivery(image: np.ndarray) -> Any:
    """A mosaic whose canvas begins at (-100, 50); one photograph shows in a rectangle of it."""
    mask = np.zeros((40, 60), np.uint8)
    mask[10:20, 30:50] = 255
    seam = SeamMask(Parcel(mask), Canvas(-10, 5, 60, 40), 0.1)
    source = Source(0, "a.jpg", Path("a.jpg"))
    placements = (Placement(source, (200, 100), np.eye(3), seam=seam), Placement(source, (200, 100), np.eye(3)))
    canvas = Canvas(-100, 50, image.shape[1], image.shape[0])
    composition = Composition(placements, canvas, coloured=True, blending="multiband", lens=Lens())
    return SimpleNamespace(preview=image, composition=composition)


def test_tiles_are_parts_of_the_mosaic(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mosaic_picture, "PICTURE_SIDE_PX", 300)
    shown = show_mosaic(delivery(MOSAIC), tmp_path)
    assert (shown.picture.width, shown.picture.height) == (300, 175)
    assert sorted({tile.scale for tile in shown.tiles}) == [0.25, 0.5]
    for scale in (0.25, 0.5):
        whole = cv2.resize(MOSAIC, None, fx=0.25 / scale, fy=0.25 / scale, interpolation=cv2.INTER_AREA)
        covered = np.zeros(whole.shape[:2], bool)
        for tile in (tile for tile in shown.tiles if tile.scale == scale):
            pixels = np.asarray(cv2.imread(str(tmp_path / Path(tile.href).name)))
            x, y = round(tile.x / scale), round(tile.y / scale)
            part = slice(y, y + len(pixels)), slice(x, x + pixels.shape[1])
            assert (tile.width / scale, tile.height / scale) == (pixels.shape[1], len(pixels))
            assert np.abs(whole[part].astype(int) - pixels).mean() < 3
            covered[part] = True
        assert covered.all()


def test_a_small_mosaic_has_no_tiles(tmp_path: Path) -> None:
    shown = show_mosaic(delivery(MOSAIC), tmp_path)
    assert shown.tiles == ()
    assert [path.name for path in tmp_path.iterdir()] == ["mosaic.jpg"]


def test_seams_lie_where_their_photograph_shows(tmp_path: Path) -> None:
    (line,) = show_mosaic(delivery(MOSAIC), tmp_path).seams
    # Mask pixels 30..49, 10..19 of a frame at (-10, 5) whose pixels are 10 of the mosaic's, on a canvas at (-100, 50).
    assert np.allclose(line.min(axis=0), (304.5, 104.5))
    assert np.allclose(line.max(axis=0), (494.5, 194.5))
