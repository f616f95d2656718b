import cv2

from sim.scene import make_pair
from skymosaic.features.detectors import detect, keep_one_per_position


def test_orientations_of_one_place_count_once() -> None:
    gray = cv2.cvtColor(make_pair(seed=9, size=(320, 240)).images[0], cv2.COLOR_BGR2GRAY)
    points = detect(gray, "sift", 500)
    single = keep_one_per_position(points)
    assert len(single) == len({point.pt for point in points}) < len(points)
    assert [point.response for point in single] == sorted((point.response for point in single), reverse=True)
