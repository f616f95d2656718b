"""Where lines lie in the drawings, and which of them a pointer means."""

import numpy as np

from skymosaic.panel.pages import drawings


def test_the_nearest_line_is_found_only_within_the_distance() -> None:
    lines = np.array([[0, 0, 100, 0], [0, 50, 100, 50], [200, 0, 200, 0]], dtype=np.float64)
    assert drawings.find_nearest(lines, 50, 10, within=12) == 0
    assert drawings.find_nearest(lines, 50, 41, within=12) == 1
    assert drawings.find_nearest(lines, 50, 25, within=12) is None
    assert drawings.find_nearest(lines, 110, 50, within=12) == 1
    assert drawings.find_nearest(lines, 203, 4, within=6) == 2
    assert drawings.find_nearest(lines[:0], 0, 0, within=1e9) is None


def test_outlines_seams_and_links_lie_where_the_photographs_do() -> None:
    square = np.array([[0.0, 0], [60, 0], [60, 40], [0, 40]])
    outlines = {"a": square, "b": square + 100, "c": np.add(square, (0, 20))}
    drawn = drawings.draw_outlines([square, square + 100])
    assert 'points="100.0,100.0 160.0,100.0 160.0,140.0 100.0,140.0"' in drawn
    assert ('x="30" y="20">1<' in drawn, 'x="130" y="120">2<' in drawn) == (True, True)
    assert 'd="M0.0 0.0L60.0 0.0L60.0 40.0Z"' in drawings.draw_seams([square[:3]])
    weak, strong = drawings.draw_links(outlines, [("a", "b", 50), ("a", "left out", 90), ("b", "c", 400)]).split("/>")[
        :2
    ]
    assert weak == (
        '<path class="link" style="stroke: hsl(30 75% 55%); stroke-width: 2.0px" d="M30.0 20.0L130.0 120.0"'
    )
    assert strong == (
        '<path class="link" style="stroke: hsl(120 75% 55%); stroke-width: 5.0px" d="M130.0 120.0L30.0 40.0"'
    )
