# amaranth: UnusedElaboratable=no
"""Non-maximum suppression equals the golden model."""

from collections.abc import Callable

import numpy as np
import pytest
from amaranth.hdl import Fragment

from golden_model.pixel import nms
from hdl.pixel.nms import Suppression

WIDTH_PX = 20


@pytest.mark.parametrize(
    ("radius_px", "detector", "pixels_per_clock"),
    [(1, "harris", 1), (3, "harris", 2), (1, "fast", 2), (3, "fast", 1)],
)
def test_suppression_equals_the_golden_model(
    check_block: Callable[..., None], radius_px: int, detector: str, pixels_per_clock: int
) -> None:
    rng = np.random.default_rng(6)
    shape = (15, 19)
    twins = np.zeros(shape, int)
    twins[6, [8, 9]] = twins[7, 7] = 9
    is_fast = detector == "fast"
    largest = 255 if is_fast else 1 << 15
    codes = [*(rng.integers(0, high, shape) for high in (2, 6, largest)), np.full(shape, 7), twins]
    rule = (1, "lose") if is_fast else (radius_px, "first")
    survivors = [nms.suppress(frame.astype(np.uint16), *rule) for frame in codes]
    assert sum(map(np.count_nonzero, survivors)) >= 15
    expected = {
        "code": survivors,
        "left": [np.roll(frame, 1, axis=1) for frame in codes],
        "right": [np.roll(frame, -1, axis=1) for frame in codes],
        "up": [np.roll(frame, 1, axis=0) for frame in codes],
        "down": [np.roll(frame, -1, axis=0) for frame in codes],
    }
    # At most one of two neighbours survives, whatever their ties: a beat of two pixels holds one corner.
    assert not any((plane[:, 1:] & plane[:, :-1]).any() for plane in (frame > 0 for frame in survivors))
    dut = Suppression(radius_px=radius_px, width_px=WIDTH_PX, pixels_per_clock=pixels_per_clock)
    settings = {"i_fast": int(is_fast)}
    check_block(dut, [{"code": frame} for frame in codes], expected, margin_px=radius_px, settings=settings)


def test_impossible_parameters_are_named() -> None:
    with pytest.raises(ValueError, match="radius_px is 2"):
        Suppression(radius_px=2, width_px=64)


@pytest.mark.usefixtures("unused_blocks")
def test_codes_that_do_not_come_with_their_scan_position_are_refused() -> None:
    dut = Suppression(radius_px=1, width_px=64)
    dut.latency_cycles += 1
    with pytest.raises(ValueError, match=r"latency_cycles of the suppression .* scan has 9, codes has 8"):
        Fragment.get(dut, None)
