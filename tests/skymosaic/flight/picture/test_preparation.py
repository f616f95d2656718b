from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from sim.scene import Flight
from skymosaic.compositing.tone import NEUTRAL
from skymosaic.flight.picture.preparation import PALETTE, equalise, thumbnail_layers
from skymosaic.mosaicking.api import open_run
from skymosaic.mosaicking.options import MosaicOptions


def test_thumbnails_need_no_larger_canvas_than_the_mosaic(flight: Flight, surveyed: Path) -> None:
    with open_run(list(flight.images), MosaicOptions(scale=0.1, cache=surveyed)) as run:
        composition = run.composition(run.layouts[0])
        layers, reduction = thumbnail_layers(composition, run.flight.views)
    assert reduction == 1
    for layer in layers:
        assert layer.footprint.intersection(composition.canvas.grown(1)) == layer.footprint
    assert composition.uneven == ""
    assert any(placement.tone is not NEUTRAL for placement in composition.placements)
    hot = [
        replace(layer, image=np.asarray(cv2.applyColorMap(layer.image[..., 1], cv2.COLORMAP_INFERNO), np.uint8))
        for layer in layers
    ]
    left_alone = equalise(composition.with_each(tone=[NEUTRAL] * len(hot)), run.flight.views, hot)
    assert left_alone.uneven == PALETTE
    assert all(placement.tone is NEUTRAL for placement in left_alone.placements)


def test_a_photograph_that_others_make_up_for_shows_nothing(flight: Flight, surveyed: Path) -> None:
    middle = flight.images[4][60:-60, 80:-80]
    with open_run([*flight.images, middle], MosaicOptions(cache=surveyed)) as run:
        assert run.layouts[0].members == tuple(range(10))
        composition = run.composition(run.layouts[0])
    shown = [placement.shows_in(composition.canvas) for placement in composition.placements]
    assert shown == [True] * 9 + [False]
