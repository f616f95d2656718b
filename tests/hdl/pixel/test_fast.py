# amaranth: UnusedElaboratable=no
"""FAST's segment test and score equal the golden model, which equals OpenCV."""

from collections.abc import Callable

import numpy as np
import pytest
from amaranth.hdl import Fragment
from numpy.typing import NDArray

from golden_model.pixel import fast
from hdl.pixel.fast import WINDOW_PX, Fast
from tests.hdl.pixel.columns import columns


def arcs() -> NDArray[np.uint8]:
    """Touching circles with runs of brighter or darker pixels, around centres of any brightness."""
    rng = np.random.default_rng(3)
    tiles = []
    for run in (8, 9, 16):
        for start, rise in ((0, 40), (5, -40), (11, 1), (14, -1), (3, 255), (8, -255)):
            tile = np.full((WINDOW_PX, WINDOW_PX), 128 - rise // 2) + rng.integers(-1, 2, (WINDOW_PX, WINDOW_PX))
            for step in range(run):
                x, y = fast.CIRCLE[(start + step) % len(fast.CIRCLE)]
                tile[fast.MARGIN_PX + y, fast.MARGIN_PX + x] += rise
            tiles.append(tile.clip(0, 255).astype(np.uint8))
    return np.block([tiles[n : n + 6] for n in range(0, len(tiles), 6)])


@pytest.mark.parametrize(("threshold", "pixels_per_clock", "lag_px"), [(1, 1, 3), (20, 2, 4)])
def test_scores_equal_the_golden_model(
    gray_frames: list[NDArray[np.uint8]],
    check_block: Callable[..., None],
    threshold: int,
    pixels_per_clock: int,
    lag_px: int,
) -> None:
    noise, _, checkerboard, *_ = gray_frames
    frames = [noise, checkerboard, arcs()]
    expected = [fast.response_code(frame, threshold) for frame in frames]
    scores = np.concatenate([plane.ravel() for plane in expected])
    assert np.count_nonzero(scores) >= 60
    assert scores.max() > 250
    assert scores[scores > 0].min() == threshold
    dut = Fast(lag_px=lag_px, pixels_per_clock=pixels_per_clock)
    check_block(
        dut,
        [{"column": columns(frame, dut.lines)} for frame in frames],
        {"code": expected},
        margin_px=lag_px,
        settings={"i_threshold_code": threshold},
    )


def test_a_lag_that_the_window_cannot_have_is_refused() -> None:
    with pytest.raises(ValueError, match="lag_px is 2; it must be a whole number from 3 on"):
        Fast(lag_px=2)


@pytest.mark.usefixtures("unused_blocks")
def test_codes_that_do_not_come_with_their_scan_position_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Fast, "latency_cycles", Fast.latency_cycles + 1)
    with pytest.raises(ValueError, match=r"latency_cycles of FAST .* scan has 23, codes has 22"):
        Fragment.get(Fast(), None)
