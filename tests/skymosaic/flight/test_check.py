from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np

from golden_model.config import preset_config
from sim.scene.flight import Flight
from skymosaic.flight.cache import NO_CACHE
from skymosaic.flight.check import check_flight, contradictions
from skymosaic.flight.layout.layout import Layout
from skymosaic.flight.linking.links import Link
from skymosaic.flight.linking.view import Settings
from skymosaic.flight.survey import survey
from skymosaic.flight.workers import Workers
from skymosaic.imagery.photographs import list_sources


def test_a_blurred_photograph_is_named(flight: Flight) -> None:
    images = list(flight.images)
    images[4] = cv2.GaussianBlur(images[4], (0, 0), 1.5)
    with Workers() as workers:
        surveyed = survey(list_sources(images), Settings(preset_config("aerial")), 0, workers, NO_CACHE)
    checked = check_flight(surveyed)
    assert [photo.name for photo in checked.photographs if "blurred" in photo.problems] == ["image 4"]
    assert checked.complete


def test_a_layout_with_many_contradicting_links_is_doubted_by_name() -> None:
    views = [SimpleNamespace(name=f"folder/{index}.jpg") for index in range(60)]
    nothing = np.zeros((0, 2))
    links = tuple(Link(view, view + 1, nothing, nothing, 0, 0) for view in range(59))
    flight: Any = SimpleNamespace(views=views)
    few = Layout(tuple(range(60)), 0, {}, links=links[1:], contradicting=links[:1])
    assert list(contradictions(flight, few)) == []
    many = Layout(tuple(range(60)), 0, {}, links=links[2:], contradicting=links[:2])
    (line,) = contradictions(flight, many)
    assert line.startswith("2 of 59 links contradict the layout (most at 1.jpg, ")
