import numpy as np

from skymosaic.flight.layout.expected_shape import are_possible


def test_cameras_see_ground_neither_mirrored_nor_edge_on_nor_at_no_size() -> None:
    level, mirrored, edge_on = np.eye(3), np.diag([-1.0, 1, 1]), np.diag([1.0, 0.05, 1])
    leaning = np.array([[1, 0, 0], [0, 0.5, 0], [0.8, -0.5, 1]])
    tiny, huge = np.diag([1e-4, 1e-4, 1]), np.diag([1e4, 1e4, 1])
    unknown = np.full((3, 3), np.nan)
    possible = are_possible(np.stack([level, mirrored, edge_on, leaning, tiny, huge, unknown]))
    assert possible.tolist() == [True, False, False, True, False, False, False]
