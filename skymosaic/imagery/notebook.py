"""Shows results in notebooks: a line of text and a small picture in one piece of HTML."""

import base64
import html

import cv2
import numpy as np

from golden_model.arrays import Pixels, Points
from skymosaic.geometry.homography import apply
from skymosaic.imagery.images import reduce_to_width

WIDTH_PX = 800
JPEG_QUALITY = 85
MAX_LINES = 200
LINE_COLOR = (0, 200, 0)


def describe_in_html(text: str, picture: Pixels | None = None) -> str:
    """A paragraph of text above a picture, which is contained in it as JPEG."""
    paragraph = f"<p>{html.escape(text)}</p>"
    if picture is None:
        return paragraph
    return f'{paragraph}<img alt="{html.escape(text)}" src="{jpeg_address(picture, WIDTH_PX)}">'


def jpeg_address(picture: Pixels, width_px: int) -> str:
    """A picture, reduced to a width, as a data URL."""
    small, _ = reduce_to_width(picture, width_px)
    return data_address(cv2.imencode(".jpg", small, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])[1].tobytes(), "jpeg")


def data_address(picture: bytes, kind: str) -> str:
    """The file of a picture as a data URL, so that a page needs no other file."""
    return f"data:image/{kind};base64,{base64.b64encode(picture).decode()}"


def draw_lines(pictures: tuple[Pixels, Pixels], points: tuple[Points, Points]) -> Pixels:
    """Draw two pictures beside each other, with lines between at most 200 of their common points (N, 2)."""
    small, ends = [], []
    for picture, places in zip(pictures, points, strict=True):
        reduced, to_original = reduce_to_width(picture, WIDTH_PX // 2)
        small.append(reduced)
        chosen = places[:: len(places) // MAX_LINES + 1]
        moved = apply(np.asarray(np.linalg.inv(to_original), np.float64), chosen)
        ends.append([cv2.KeyPoint(x, y, 1) for x, y in moved.tolist()])
    lines = [cv2.DMatch(index, index, 0) for index in range(len(ends[0]))]
    drawn = cv2.drawMatches(small[0], ends[0], small[1], ends[1], lines, np.zeros(0), LINE_COLOR)
    return np.asarray(drawn, dtype=np.uint8)
