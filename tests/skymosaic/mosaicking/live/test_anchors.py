import numpy as np
import pytest
from numpy.typing import NDArray

from golden_model.arrays import Records
from golden_model.config import preset_config
from golden_model.front_end import extract
from sim.scene import Flight
from skymosaic.mosaicking.live.anchors import MIN_FRAMES, Anchors
from tests.skymosaic.conftest import SIZE
from tests.skymosaic.mosaicking.live.conftest import pair_errors_px

LAYOUT_EVERY = 5
CONFIG = preset_config("aerial")


@pytest.fixture(scope="module")
def features(frames: list[NDArray[np.uint8]]) -> list[Records]:
    return [extract(frame, CONFIG.front_end).features for frame in frames]


def test_the_canvas_keeps_its_place_while_the_layout_improves(flight: Flight, features: list[Records]) -> None:
    """Each frame is held against all before it as they were placed, whatever later layouts make of them."""
    anchors, places = Anchors(SIZE, CONFIG), {}
    for number, each in enumerate(features):
        slot = each.copy()
        place = anchors.add(number, slot)
        # A ring writes the next frame there.
        slot[:] = 0
        assert (place is None) == (number < LAYOUT_EVERY)
        if place is not None:
            places[number] = place
        if number % LAYOUT_EVERY == LAYOUT_EVERY - 1:
            anchors.lay_out()
    errors = pair_errors_px(places, flight)
    assert len(errors) > 3
    assert errors.max() < 0.15


def test_a_layout_of_too_few_frames_makes_no_canvas(features: list[Records]) -> None:
    anchors = Anchors(SIZE, CONFIG)
    for number, each in enumerate(features[: MIN_FRAMES - 1]):
        anchors.lay_out()
        assert anchors.add(number, each) is None
    anchors.lay_out()
    assert anchors.add(MIN_FRAMES - 1, features[MIN_FRAMES - 1]) is None


def test_a_frame_of_other_ground_is_not_placed(features: list[Records]) -> None:
    anchors = Anchors(SIZE, CONFIG)
    for number, each in enumerate(features[:MIN_FRAMES]):
        anchors.add(number, each)
    anchors.lay_out()
    elsewhere = features[MIN_FRAMES].copy()
    elsewhere["descriptor"] = np.random.default_rng(1).integers(0, 256, elsewhere["descriptor"].shape)
    assert anchors.add(MIN_FRAMES, elsewhere) is None
    assert anchors.add(MIN_FRAMES + 1, features[MIN_FRAMES]) is not None


def test_what_never_changes_is_no_ground(features: list[Records]) -> None:
    """A display, or dirt on the lens: as good as no motion."""
    anchors = Anchors(SIZE, CONFIG)
    for number in range(2 * MIN_FRAMES):
        assert anchors.add(number, features[0]) is None
        anchors.lay_out()
    # A frame that stands still is placed by those before it.
    for number, each in enumerate(features[: MIN_FRAMES + 1], 2 * MIN_FRAMES):
        anchors.add(number, each)
    anchors.lay_out()
    assert anchors.add(3 * MIN_FRAMES + 1, features[MIN_FRAMES]) is not None
