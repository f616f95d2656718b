"""Seams of frames whose poses are off by what is known, and anchors that come late."""

from types import SimpleNamespace

import numpy as np
import pytest
from numpy.typing import NDArray

from bench.painter import DELAY, STEP_PX, find_owners, find_seams, place_frames
from golden_model.geometry.fixed_point import quantise
from golden_model.records import HOMOGRAPHY
from sim.scene import Camera

CAMERA = Camera(width_px=160, height_px=120, focal_px=130)


def shift(x: float, y: float) -> NDArray[np.float64]:
    return np.array([[1, 0, -x], [0, 1, -y], [0, 0, 1.0]])


def test_a_seam_is_as_wide_as_its_frames_are_apart() -> None:
    """Frames that overlap by 16 px; the last is painted 3 px too far to the right and 4 px too low."""
    exact = [shift(1000 + 144 * number, 500) for number in range(4)]
    poses = {number: shift(144 * number, 0) for number in range(3)} | {3: shift(435, 4)}
    seams = find_seams(CAMERA, poses, exact)
    assert {frozenset(pair) for pair in seams} == {frozenset((number, number + 1)) for number in range(3)}
    widths = np.concatenate([*seams.values()]).round(6).tolist()
    assert set(widths) == {0, 5}
    # Neighbours meet over the height of a frame.
    assert widths.count(0) == pytest.approx(2 * 120 / STEP_PX, rel=0.1)
    assert widths.count(5) == pytest.approx(120 / STEP_PX, rel=0.1)


def test_the_frame_with_the_farthest_border_is_shown() -> None:
    owners, low = find_owners(CAMERA, {4: shift(10, 0), 7: shift(90, 0)})
    at = (np.array([[60, 60], [200, 60], [120, 60], [140, 60]]) - low) // STEP_PX
    assert [owners[y, x] for x, y in at.astype(int)] == [4, 7, 4, 7]
    assert set(np.unique(owners)) <= {-1, 4, 7}


def test_an_anchor_counts_from_the_frame_after_the_delay() -> None:
    """Each link of the chip is half a pixel too long."""
    records = []
    for number in range(8):
        record = np.zeros(1, HOMOGRAPHY.dtype)[0]
        record["causes"], record["frame"], record["reference"] = number == 0, number, max(number - 1, 0)
        for (row, column), element in np.ndenumerate(quantise(shift(10.5, 0)[np.newaxis])[0].astype(np.uint32)):
            record[f"h{row}{column}"] = element
        records.append(SimpleNamespace(homography=record))
    anchors = {number: shift(10 * number, 0) for number in (1, 4)}
    placed = place_frames(records, anchors)  # type: ignore[arg-type]
    off = {number: -pose[0, 2] - 10 * number for number, pose in placed.items()}
    first, second = 1 + DELAY + 1, 4 + DELAY + 1
    assert min(placed) == first
    expected = {number: 0.5 * (number - (4 if number >= second else 1)) for number in range(first, 8)}
    assert off == pytest.approx(expected, abs=0.01)
