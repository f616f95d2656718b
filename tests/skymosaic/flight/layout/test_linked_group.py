from typing import Any

import numpy as np

from skymosaic.flight.layout.expected_shape import are_possible
from skymosaic.flight.layout.linked_group import linked_group, trust_by_loops
from skymosaic.flight.linking.links import Link
from tests.skymosaic.flight.layout.cameras import views_of


def test_a_loop_that_does_not_close_takes_trust_from_its_links() -> None:
    def shifted(x: Any) -> Any:
        return np.array([[1.0, 0, x], [0, 1, 0], [0, 0, 1]])

    pairs = {(0, 1): 0, (1, 2): 1, (0, 2): 2, (2, 3): 3}
    closed = trust_by_loops(pairs, np.array([shifted(1), shifted(1), shifted(2), shifted(1)]))
    opened = trust_by_loops(pairs, np.array([shifted(1), shifted(1), shifted(2.5), shifted(1)]))
    assert closed[0] > closed[3] > opened[0]
    assert closed[3] == opened[3]


def test_a_loop_that_is_open_in_place_and_turn_is_trusted_less_than_one_open_in_either() -> None:
    def trust(angle_deg: float, x: float) -> float:
        cosine, sine = np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))
        gap = np.array([[cosine, -sine, x], [sine, cosine, 0], [0, 0, 1]])
        return float(trust_by_loops({(0, 1): 0, (1, 2): 1, (0, 2): 2}, np.stack([np.eye(3), np.eye(3), gap]))[0])

    closed, turned, moved, both = (trust(*each) for each in ((0, 0), (3, 0), (0, 0.04), (3, 0.04)))
    assert closed > max(turned, moved)
    assert min(turned, moved) > 1.1 * both


def test_a_link_that_mirrors_or_shrinks_its_view_to_a_point_leaves_it_where_its_neighbour_lies() -> None:
    points = np.array([[0.0, 0], [600, 0], [600, 450], [0, 450]] * 3)
    shrunk, one_place = 300 + 1e-4 * points, np.full_like(points, 300)
    mirrored = np.array([639.0, 0]) - points * np.array([1.0, -1])
    links = [Link(row, row + 1, points, right, 12, 12) for row, right in enumerate((shrunk, mirrored, one_place))]
    start = linked_group(views_of(4), range(4), links).start
    assert are_possible(start).all()
