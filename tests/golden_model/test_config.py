"""Configurations: sizes and validation."""

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from golden_model.config import FrontEndConfig, preset_config


@pytest.mark.parametrize(
    ("size_px", "cell_px", "per_cell"),
    [((640, 480), 32, 5), ((1280, 720), 64, 7), ((1600, 900), 64, 4), ((1920, 1080), 64, 3), ((64, 64), 32, 5)],
)
def test_cells_by_frame_size(size_px: tuple[int, int], cell_px: int, per_cell: int) -> None:
    config = FrontEndConfig().for_size(*size_px)
    assert (config.cell_px, config.per_cell) == (cell_px, per_cell)
    assert config.for_size(*size_px) == config


@given(st.integers(64, 4096), st.integers(64, 4096))
def test_selected_features_always_fit_the_bank(width_px: int, height_px: int) -> None:
    config = FrontEndConfig().for_size(width_px, height_px)
    assert config.cell_px
    assert config.per_cell
    assert config.count_cells(width_px, height_px, config.cell_px) * config.per_cell <= config.max_features


def test_given_cells_stay() -> None:
    assert FrontEndConfig(cell_px=128).for_size(640, 480).cell_px == 128
    assert FrontEndConfig(per_cell=8).for_size(640, 480).cell_px == 64
    with pytest.raises(ValueError, match="1920x1080: no cell size keeps the features within 2048; use a larger"):
        FrontEndConfig(cell_px=32, per_cell=5).for_size(1920, 1080)


@pytest.mark.parametrize("size_px", [(63, 480), (640, 5000)])
def test_a_frame_size_out_of_range_is_refused(size_px: tuple[int, int]) -> None:
    with pytest.raises(ValueError, match="it must be a whole number from 64 to 4096"):
        FrontEndConfig().for_size(*size_px)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"detector": "sift"}, "detector is 'sift'; valid: harris, fast"),
        ({"levels": True}, "levels is True; valid: 1, 2"),
        ({"smoothed_gradients": 1}, "smoothed_gradients is 1; valid: true, false"),
        ({"smoothed_gradients": False}, "tensor_window_px without smoothed_gradients is 5; valid: 3"),
        ({"harris_k_numerator": 4}, "harris_k_numerator is 4; it must be a whole number from 0 to 3"),
        ({"threshold": 2.5}, "threshold is 2.5; it must be a whole number from 1 to 1073741823"),
        ({"detector": "fast", "threshold": 255}, "threshold is 255; it must be a whole number from 1 to 254"),
        ({"border_px": 19}, "border_px is 19; it must be a whole number from 20 to 255"),
        ({"selection": False}, "selection is False, but two levels are ordered by cells; set levels = 1"),
        ({"selection": False, "levels": 1, "per_cell": 3}, "selection is False, but cell_px or per_cell is set"),
    ],
)
def test_impossible_values_are_named(values: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        FrontEndConfig(**values)


def test_preset_by_name() -> None:
    assert preset_config("thesis").front_end.pattern.name == "thesis-ilbp-4"
    with pytest.raises(ValueError, match="preset is 'nasa'; valid: aerial, thesis"):
        preset_config("nasa")
