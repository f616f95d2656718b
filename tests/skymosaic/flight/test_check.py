import cv2

from golden_model.config import preset_config
from skymosaic.flight.cache import NO_CACHE
from skymosaic.flight.check import check_flight
from skymosaic.flight.linking.view import Settings
from skymosaic.flight.survey import survey
from skymosaic.flight.workers import Workers
from skymosaic.imagery.photographs import list_sources


def test_a_blurred_photograph_is_named(flight):
    images = list(flight.images)
    images[4] = cv2.GaussianBlur(images[4], (0, 0), 1.5)
    with Workers() as workers:
        surveyed = survey(list_sources(images), Settings(preset_config("aerial")), 0, workers, NO_CACHE)
    checked = check_flight(surveyed)
    assert [photo.name for photo in checked.photographs if "blurred" in photo.problems] == ["image 4"]
    assert checked.complete
