"""Links that rest on the chip's records alone."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from golden_model.config import preset_config
from skymosaic.mosaicking.live import record_chain
from skymosaic.mosaicking.live.record_chain import RecordChain, link_by_record

RECORD: Any = {"inliers": 40}


@pytest.mark.parametrize(("width_px", "height_px", "columns", "rows"), [(101, 51, 11, 10), (100, 50, 10, 9)])
def test_a_link_ties_what_both_frames_show_of_a_grid(
    monkeypatch: pytest.MonkeyPatch, width_px: int, height_px: int, columns: int, rows: int
) -> None:
    """Of points 10 px apart across and 5 px down, those at the border of the right frame count."""
    shift = np.array([[1.0, 0, -10], [0, 1, 5], [0, 0, 1]])
    monkeypatch.setattr(record_chain, "homography_in_pixels", lambda _record: shift)
    link = link_by_record((3, 4), RECORD, np.zeros((56, 111), np.uint8), np.zeros((height_px, width_px), np.uint8))
    assert (link.left, link.right, link.inliers, link.near, len(link.left_points)) == (3, 4, 40, 40, columns * rows)
    assert link.left_points.min(axis=0).tolist() == [10, 0]
    assert link.right_points.max(axis=0).tolist() == [10 * (columns - 1), 5 * rows]
    assert link.right_points - link.left_points == pytest.approx(np.tile([-10, 5], (columns * rows, 1)))


def test_only_the_newest_frame_and_the_one_before_are_linked(monkeypatch: pytest.MonkeyPatch) -> None:
    seen, records = list[list[int]](), iter([None, None, RECORD, RECORD])
    monkeypatch.setattr(record_chain, "homography_in_pixels", lambda _record: np.eye(3))

    def run(frames: list[Any], _config: Any) -> list[Any]:
        seen.append([int(frame[0, 0]) for frame in frames])
        record = next(records)
        results = [SimpleNamespace(features=f"of {frame[0, 0]}", homography=record) for frame in frames]
        return [SimpleNamespace(**vars(each), status={"causes": 0}) for each in results]

    front_end: Any = SimpleNamespace(run=run)
    chain, holding = RecordChain(front_end, preset_config("aerial"), seed=0), list[list[tuple[int, int]]]()
    for number in range(4):
        assert chain.describe(number, np.full((64, 64), number, np.uint8)) == f"of {number}"
        pairs = [(left, right) for right in range(1, 4) for left in range(right)]
        holding.append([pair for pair in pairs if chain.link(pair).inliers])
        assert all((chain.link(pair).left, chain.link(pair).right) == pair for pair in pairs)
    none = chain.link((0, 1))
    assert (none.left_points.shape, none.right_points.shape, none.near) == ((0, 2), (0, 2), 0)
    assert seen == [[0], [0, 1], [1, 2], [2, 3]]
    assert holding == [[], [], [(1, 2)], [(2, 3)]]
