"""A plot of matches shows both photographs beside each other, and lines that end on their points."""

from typing import Any

import numpy as np
import pytest

from skymosaic.registration.match_plot import draw_matches


@pytest.mark.parametrize("colour", [False, True])
def test_lines_end_on_their_points_in_photographs_of_two_sizes(colour: bool) -> None:
    rng = np.random.default_rng(1)
    images = [rng.integers(0, 256, (*size, 3) if colour else size, np.uint8) for size in ((60, 100), (90, 80))]
    left, right = np.array([[3.0, 4], [99, 59]]), np.array([[0.0, 0], [79, 89]])
    figure = draw_matches((images[0], images[1]), left, right, np.array([0.2, 0.9]), title="costs $5, not $6")
    axes: list[Any] = figure.axes
    plot, scale = axes
    for shown, image, (start, end, below) in zip(
        plot.images, images, ((-0.5, 99.5, 59.5), (101.5, 181.5, 89.5)), strict=True
    ):
        assert shown.get_extent() == [start, end, below, -0.5]
        assert np.array_equal(shown.get_array(), image[..., ::-1] if colour else image)
        assert (shown.norm.vmin, shown.norm.vmax) == (0, 255)
    assert (plot.get_xlim(), plot.get_ylim()) == ((-0.5, 181.5), (89.5, -0.5))
    (lines,) = plot.collections
    np.testing.assert_allclose(lines.get_segments(), [[(3, 4), (102, 0)], [(99, 59), (181, 89)]])
    assert (lines.get_array().tolist(), lines.get_clim()) == ([0.2, 0.9], (0, 1))
    assert (scale.get_ylabel(), plot.axison) == ("weight of the match", False)
    assert not plot.title.get_parse_math()
    assert figure.get_size_inches() == pytest.approx([5 * 182 / 90, 6])
