"""Corners of both detectors equal the golden model, and describe the same pixel."""

import dataclasses
from collections.abc import Callable

import numpy as np
import pytest

from golden_model.config import DETECTORS, FrontEndConfig
from golden_model.pixel import fast, nms
from hdl.pixel.corners import Corners
from hdl.pixel.gradients import GradientColumns
from hdl.pixel.harris import StructureTensor
from tests.hdl.pixel.columns import columns

CONFIG = FrontEndConfig(levels=1, threshold=30)
WIDTH_PX = 27


@pytest.fixture
def two_more_lines(monkeypatch: pytest.MonkeyPatch) -> None:
    """Line memories for a window of 7 px, around a structure tensor of 5."""
    for module in ("harris", "gradients"):
        monkeypatch.setattr(f"hdl.pixel.{module}.TENSOR_LINES", 7)
    monkeypatch.setattr(GradientColumns, "pixel_lines", 9)
    monkeypatch.setattr(StructureTensor, "lag_px", 3)


@pytest.mark.usefixtures("two_more_lines")
def test_corners_of_a_larger_window_equal_the_golden_model(check_block: Callable[..., None]) -> None:
    """FAST's, which wait for those of Harris."""
    frame = np.random.default_rng(2).integers(0, 256, (26, WIDTH_PX), dtype=np.uint8)
    config = dataclasses.replace(CONFIG, detector="fast")
    codes = fast.response_code(frame, config.threshold)
    survivors = nms.suppress(codes, *config.suppression)
    dut = Corners(config=config, width_px=WIDTH_PX)
    inside = slice(dut.lag_px, -dut.lag_px)
    assert survivors[inside, inside].any()
    assert np.count_nonzero(codes[inside, inside]) > 20
    settings = {"i_fast": DETECTORS.index("fast"), "i_threshold_code": config.threshold}
    expected = {"code": [survivors], "left": [np.roll(codes, 1, axis=1)]}
    check_block(dut, [{"column": columns(frame, 3)}], expected, margin_px=dut.lag_px, settings=settings)


@pytest.mark.usefixtures("unused_blocks")
def test_detectors_of_different_lags_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    """FAST waits for Harris; nothing makes Harris wait."""
    monkeypatch.setattr(StructureTensor, "lag_px", 1)
    with pytest.raises(ValueError, match="lag_px is 2; it must be a whole number from 3 on"):
        Corners(config=CONFIG, width_px=WIDTH_PX)


@pytest.mark.usefixtures("unused_blocks")
def test_lines_that_end_above_the_window_of_fast_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(GradientColumns, "pixel_lines", 6)
    with pytest.raises(ValueError, match=r"FAST needs \d lines of pixels, but 6 are stored"):
        Corners(config=CONFIG, width_px=WIDTH_PX)
