"""Layouts of flights in which repeated textures link pictures falsely, against the exact poses."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from sim.scene import make_lawnmower
from sim.scene.flight import Flight
from sim.scene.ties import tie_pictures
from skymosaic.flight.layout.layout import Layout, lay_out, trust_by_loops
from skymosaic.flight.linking.links import Link
from skymosaic.geometry.homography import apply, estimate

SIZE_PX = (1280, 960)
PICTURES = 30


def laid_out(seed: int, false_share: float, period_px: int) -> tuple[Any, ...]:
    """A flight, its layout, and the pairs that were planted."""
    flight = make_lawnmower(seed, PICTURES, SIZE_PX)
    tied = tie_pictures(flight, seed, false_share, period_px)
    links = [Link(t.left, t.right, t.left_points, t.right_points, *(len(t.left_points),) * 2) for t in tied]
    views: list[Any] = [SimpleNamespace(size=SIZE_PX, working_size=SIZE_PX)] * PICTURES
    return flight, lay_out(views, range(PICTURES), links), {(t.left, t.right) for t in tied if not t.true}


def position_errors_px(flight: Flight, layout: Layout) -> NDArray[np.float64]:
    grid = np.stack(np.meshgrid(*(np.linspace(0, side - 1, 4) for side in SIZE_PX)), axis=-1).reshape(-1, 2)
    estimated = np.array([apply(layout.transforms[member], grid) for member in layout.members])
    true = np.array(
        [apply(np.asarray(np.linalg.inv(flight.homographies[member]), np.float64), grid) for member in layout.members]
    )
    alignment = estimate(estimated.reshape(-1, 2), true.reshape(-1, 2), model="similarity")
    return np.linalg.norm(apply(alignment, estimated) - true, axis=-1).mean(axis=1)


@pytest.mark.parametrize("period_px", [60, 250], ids=["facade", "roofs"])
@pytest.mark.parametrize("false_share", [0.05, 0.1, 0.2])
def test_false_links_of_repeated_textures_are_found_and_move_no_photograph(false_share: float, period_px: int) -> None:
    flight, layout, planted = laid_out(1, false_share, period_px)
    assert len(planted) >= 5
    assert {(link.left, link.right) for link in layout.contradicting} == planted
    assert position_errors_px(flight, layout).max() < 1


def test_without_false_links_none_contradicts() -> None:
    flight, layout, _ = laid_out(2, 0, 100)
    assert layout.contradicting == ()
    assert position_errors_px(flight, layout).max() < 0.5


def test_a_loop_that_does_not_close_takes_trust_from_its_links() -> None:
    def shifted(x: Any) -> Any:
        return np.array([[1.0, 0, x], [0, 1, 0], [0, 0, 1]])

    pairs = {(0, 1): 0, (1, 2): 1, (0, 2): 2, (2, 3): 3}
    closed = trust_by_loops(pairs, [shifted(1), shifted(1), shifted(2), shifted(1)])
    opened = trust_by_loops(pairs, [shifted(1), shifted(1), shifted(2.5), shifted(1)])
    assert closed[0] > closed[3] > opened[0]
    assert closed[3] == opened[3]
