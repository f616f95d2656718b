"""Composed poses keep to double precision over a thousand links; what is no pose is refused and changes nothing."""

from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from golden_model.arrays import Array
from golden_model.geometry.fixed_point import ENTRY, quantise
from golden_model.painting.pose import POSE, Placement, PoseCause, Poses, compose, determinant
from tests.golden_model.painting.poses import homography, in_pixels, pose

SIZE = (1280, 720)


def by_host(frame: int, H: Array, reference: int = 0) -> Placement:
    return Placement(frame, reference, quantise(H[np.newaxis])[0], composed=False)


def by_record(frame: int, reference: int, H: Array | None = None) -> Placement:
    return Placement(frame, reference, quantise((np.eye(3) if H is None else H)[np.newaxis])[0], composed=True)


def test_a_thousand_links_keep_to_double_precision() -> None:
    """A flight in circles, turning, tilting and climbing: zoom 0.5 to 2."""
    views = [
        homography(
            SIZE,
            2048 + 1200 * np.array([np.cos(k / 40), np.sin(k / 50)]),
            zoom=2 ** np.sin(k / 70),
            turn=k / 30,
            tilt=1e-4 * np.array([np.sin(k / 9), np.cos(k / 11)]),
        )
        for k in range(1001)
    ]
    chained, exact = pose(views[0]), in_pixels(pose(views[0]))
    corners = np.array([[x, y, 1] for x in (0, SIZE[0]) for y in (0, SIZE[1])]).T
    worst_px = 0.0
    for before, after in pairwise(views):
        record = quantise((after @ np.linalg.inv(before))[np.newaxis])[0]
        chained = compose(record, chained)
        exact = in_pixels(record) @ exact
        exact /= np.abs(exact).max()
        assert POSE.bits - 2 <= int(np.abs(chained).max()).bit_length() <= POSE.bits - 1
        seen = in_pixels(chained) @ np.linalg.inv(exact) @ corners
        worst_px = max(worst_px, np.abs(seen[:2] / seen[2] - corners[:2]).max())
    assert worst_px < 0.001


def test_the_determinant_is_that_of_the_elements() -> None:
    rng = np.random.default_rng(7)
    for _ in range(50):
        each = rng.integers(-(1 << 37), 1 << 37, (3, 3))
        exact = np.linalg.det(each / 2.0**37) * 2.0**59
        assert abs(determinant(each) - exact) < 2.0**38
    extremes = np.full((3, 3), POSE.min_raw)
    assert determinant(extremes) == 0


@pytest.mark.parametrize(
    ("H", "cause"),
    [
        (np.diag([1.0, 1, 0]), PoseCause.SINGULAR),
        (np.diag([-1.0, 1, 1]), PoseCause.SINGULAR),
        (-homography(SIZE, (500, 500)), PoseCause.SINGULAR),
        (homography(SIZE, (500, 500), zoom=1e-4), PoseCause.SINGULAR),
        (homography(SIZE, (500, 500), zoom=0.01), PoseCause(0)),
        (homography(SIZE, (2000, 500), turn=2, zoom=4, tilt=(8e-4, -8e-4)), PoseCause(0)),
    ],
)
def test_a_host_cannot_set_what_is_no_pose(H: Array, cause: PoseCause) -> None:
    found, causes = Poses().place(by_host(1, H))
    assert causes == cause
    assert (found is None) == bool(cause)
    elements = quantise(H[np.newaxis])[0]
    assert Poses().place(Placement(1, 0, elements * (ENTRY.max_raw + 2), composed=False))[1] == PoseCause.OUT_OF_RANGE


def test_two_poses_are_kept_and_a_refused_one_changes_nothing() -> None:
    poses = Poses(max_links=2)
    start = homography(SIZE, (900, 900), turn=1)

    def causes(placement: Placement) -> Any:
        return poses.place(placement)[1]

    assert causes(by_record(1, 0)) == PoseCause.UNKNOWN_REFERENCE
    assert causes(by_host(0, start)) == 0
    assert causes(by_record(0, 0)) == PoseCause.UNKNOWN_REFERENCE
    assert causes(by_record(1, 0)) == 0
    # The reference is held, and set anew while others refer to it.
    assert causes(by_record(2, 0, np.diag([1.0, -1, 1]))) == PoseCause.SINGULAR
    assert causes(by_record(2, 0)) == 0
    assert causes(by_record(3, 1)) == PoseCause.UNKNOWN_REFERENCE
    moved = homography(SIZE, (950, 900), turn=1)
    assert causes(by_host(0, moved)) == 0
    found, none = poses.place(by_record(3, 0))
    assert none == 0
    assert found is not None
    np.testing.assert_allclose(in_pixels(found) / found[2, 2], in_pixels(pose(moved)) / pose(moved)[2, 2], atol=1e-3)
    # The newest becomes the reference, until there are too many links.
    assert causes(by_record(4, 3)) == 0
    assert causes(by_record(5, 4)) == PoseCause.UNANCHORED
    assert causes(by_host(5, start, reference=3)) == 0
    assert causes(by_record(6, 4)) == PoseCause.UNKNOWN_REFERENCE
    assert causes(by_record(6, 3)) == 0
