from sim.scene import Flight
from skymosaic.flight.picture.preparation import thumbnail_layers
from skymosaic.mosaicking.api import open_plan
from skymosaic.mosaicking.options import MosaicOptions


def test_thumbnails_need_no_larger_canvas_than_the_mosaic(flight: Flight) -> None:
    with open_plan(list(flight.images), MosaicOptions(scale=0.1)) as plan:
        composition = plan.composition(plan.layouts[0])
        layers, reduction = thumbnail_layers(composition, plan.flight.views)
    assert reduction == 1
    for layer in layers:
        assert layer.footprint.intersection(composition.canvas.grown(1)) == layer.footprint
