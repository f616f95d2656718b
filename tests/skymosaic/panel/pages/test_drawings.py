"""Where lines lie in the drawings, and which of them a pointer means."""

import numpy as np

from golden_model.config import preset_config
from golden_model.records import MATCH
from skymosaic.panel.pages import drawings


def test_the_nearest_line_is_found_only_within_the_distance() -> None:
    lines = np.array([[0, 0, 100, 0], [0, 50, 100, 50], [200, 0, 200, 0]], dtype=np.float64)
    assert drawings.find_nearest(lines, 50, 10, within=12) == 0
    assert drawings.find_nearest(lines, 50, 41, within=12) == 1
    assert drawings.find_nearest(lines, 50, 25, within=12) is None
    assert drawings.find_nearest(lines, 110, 50, within=12) == 1
    assert drawings.find_nearest(lines, 203, 4, within=6) == 2
    assert drawings.find_nearest(lines[:0], 0, 0, within=1e9) is None
    assert drawings.find_nearest(lines[:1], 50, 12, within=12) == 0
    assert drawings.find_nearest(lines[:1], -9, 12, within=15) == 0
    assert drawings.find_nearest(lines[:1], -9, 12, within=14.9) is None


def test_outlines_seams_and_links_lie_where_the_photographs_do() -> None:
    square = np.array([[0.0, 0], [60, 0], [60, 40], [0, 40]])
    outlines = {"a": square, "b": square + 100, "c": np.add(square, (0, 20))}
    drawn = drawings.draw_outlines([square, square + 100])
    assert 'points="100.0,100.0 160.0,100.0 160.0,140.0 100.0,140.0"' in drawn
    assert ('x="30" y="20">1<' in drawn, 'x="130" y="120">2<' in drawn) == (True, True)
    assert 'd="M0.0 0.0L60.0 0.0L60.0 40.0Z"' in drawings.draw_seams([square[:3]])
    linked = [("a", "b", 50), ("a", "left out", 90), ("left out", "b", 90), ("b", "c", 400), ("b", "c", 199)]
    weak, strong, almost, end = drawings.draw_links(outlines, linked).split("/>")
    assert (end, "hsl(119 " in almost) == ("", True)
    assert weak == (
        '<path class="link" style="stroke: hsl(30 75% 55%); stroke-width: 2.0px" d="M30.0 20.0L130.0 120.0"'
    )
    assert strong == (
        '<path class="link" style="stroke: hsl(120 75% 55%); stroke-width: 5.0px" d="M130.0 120.0L30.0 40.0"'
    )


def test_corners_have_ticks_along_their_orientation() -> None:
    corners = np.zeros(2, preset_config("aerial").front_end.pattern.record.dtype)
    corners["x"], corners["y"], corners["level"], corners["sector"] = (168, 320), (32, 48), (0, 1), (4, 9)
    assert drawings.draw_corners(corners, offset_px=50) == (
        '<path class="tick level-0" d="M60.5 2.0l0.0 7.0"/><path class="dot level-0" d="M60.5 2.0h0"/>'
        '<path class="tick level-1" d="M70.0 3.0l-12.9 -5.4"/><path class="dot level-1" d="M70.0 3.0h0"/>'
    )


def test_matches_are_drawn_rejected_ones_first_and_the_chosen_one_on_top() -> None:
    matches = np.zeros(3, MATCH.dtype)
    matches["left_x"], matches["left_y"], matches["right_x"], matches["right_y"] = (16, 32, 48), 8, (160, 176, 192), 24
    lines = drawings.locate_matches(matches, offset_px=100)
    assert lines.tolist() == [[1, 0.5, 110, 1.5], [2, 0.5, 111, 1.5], [3, 0.5, 112, 1.5]]
    assert drawings.draw_matches(lines, ["inlier", "outlier", "rejected"], [0, 2]) == (
        '<path class="match rejected" d="M3.0 0.5L112.0 1.5"/><path class="match inlier" d="M1.0 0.5L110.0 1.5"/>'
    )
    assert drawings.draw_chosen_match(lines[1], "outlier") == (
        '<path class="match chosen-back" d="M2.0 0.5L111.0 1.5"/><path class="match chosen outlier" '
        'd="M2.0 0.5L111.0 1.5"/><path class="chosen-end outlier" d="M2.0 0.5h0M111.0 1.5h0"/>'
    )
