"""Configurations: sizes, validation, reading and writing TOML."""

import dataclasses
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from golden_model.config import (
    PRESETS,
    Config,
    FrontEndConfig,
    MatcherConfig,
    load_config,
    preset_config,
    to_toml,
)
from golden_model.feature.ilbp import PATTERNS

front_ends = st.builds(
    FrontEndConfig,
    detector=st.sampled_from(["harris", "fast"]),
    levels=st.sampled_from([1, 2]),
    harris_k_numerator=st.integers(0, 15),
    harris_k_shift=st.integers(6, 15),
    threshold=st.integers(1, 254),
    suppression_radius_px=st.sampled_from([1, 3]),
    border_px=st.integers(20, 255),
    cell_px=st.sampled_from([None, 32, 256]),
    per_cell=st.one_of(st.none(), st.integers(1, 8)),
    max_features=st.integers(16, 4096),
    descriptor=st.sampled_from(sorted(PATTERNS)),
)
configs = st.builds(
    Config,
    preset=st.sampled_from(sorted(PRESETS)),
    front_end=st.one_of(front_ends, st.sampled_from([config.front_end for config in PRESETS.values()])),
    matcher=st.builds(MatcherConfig, rule_base=st.sampled_from(["aerial", "none"]), keep_above=st.integers(0, 255)),
)


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


@given(config=configs)
def test_toml_round_trip_is_exact(tmp_path_factory: pytest.TempPathFactory, config: Any) -> None:
    path = tmp_path_factory.getbasetemp() / "config.toml"
    path.write_text(to_toml(config))
    assert load_config(path) == config


def test_file_changes_a_preset(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text("[front_end]\nthreshold = 9\n")
    assert load_config(path).front_end == FrontEndConfig(threshold=9)
    thesis = PRESETS["thesis"]
    expected = dataclasses.replace(thesis, front_end=dataclasses.replace(thesis.front_end, threshold=9))
    assert load_config(path, preset="thesis") == expected
    path.write_text('preset = "thesis"\n[front_end]\nthreshold = 9\n')
    assert load_config(path) == expected


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[front_end]\ntreshold = 3\n", "unknown key front_end.treshold; valid: detector, levels, "),
        ("[frontend]\n", "unknown key frontend; valid: preset, front_end, matcher"),
        ("front_end = 3\n", r"front_end is 3; it must be a table, \[front_end\]"),
        ("[matcher]\nkeep_above = '64'\n", "matcher.keep_above is '64'; it must be a whole number from 0 to 255"),
        ("preset = 'nasa'\n", "preset is 'nasa'; valid: aerial, thesis"),
        ("[matcher\n", "not valid TOML: .*line 1"),
    ],
)
def test_a_bad_file_is_named_with_its_key(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "bad.toml"
    path.write_text(text)
    with pytest.raises(ValueError, match=f"bad.toml: {message}") as failure:
        load_config(path)
    assert "\n" not in str(failure.value)


def test_an_unreadable_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"none.toml: cannot be read \(No such file or directory\); give a TOML file"):
        load_config(tmp_path / "none.toml")
    (tmp_path / "binary.toml").write_bytes(b"\xff\xfe")
    with pytest.raises(ValueError, match=r"binary\.toml: not valid TOML"):
        load_config(tmp_path / "binary.toml")
