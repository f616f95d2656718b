"""Results in notebooks: text that is escaped, a picture that is reduced, and lines between common points."""

import base64
import re

import cv2
import numpy as np

from skymosaic.imagery.notebook import describe_in_html, draw_lines


def test_a_picture_stands_below_its_text() -> None:
    assert describe_in_html("2 < 3") == "<p>2 &lt; 3</p>"
    shown = describe_in_html("2 < 3", np.full((500, 1600, 3), (10, 120, 240), np.uint8))
    found = re.fullmatch(r'<p>2 &lt; 3</p><img alt="2 &lt; 3" src="data:image/jpeg;base64,(.+)">', shown)
    assert found
    pixels = cv2.imdecode(np.frombuffer(base64.b64decode(found[1]), np.uint8), cv2.IMREAD_COLOR)
    assert pixels is not None
    assert pixels.shape == (250, 800, 3)
    np.testing.assert_allclose(pixels[100, 100].astype(int), (10, 120, 240), atol=3)


def test_lines_join_at_most_200_common_points() -> None:
    pictures = np.zeros((1000, 800, 3), np.uint8), np.zeros((1000, 800, 3), np.uint8)
    rows = np.arange(400, dtype=np.float64) * 2 + 50
    points = np.column_stack([np.full(400, 700.0), rows])
    drawn = draw_lines(pictures, (points, points))
    assert drawn.shape == (500, 800, 3)
    # Every third of them, at half its place; lines are smooth at their edges.
    assert np.flatnonzero(drawn[:, 500, 1] > 128).tolist() == list(range(25, 25 + 3 * 134, 3))
