"""Configurations: sizes, validation, and their files."""

import dataclasses
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from golden_model.config import DETECTORS, PRESETS, Config, FrontEndConfig, MatcherConfig
from golden_model.config_file import load_config, to_toml
from golden_model.feature.ilbp import PATTERNS


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


@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize(("height_px", "cells"), [(64, 40), (81, 40), (82, 40 + 10)])
def test_a_level_that_is_too_low_or_narrow_for_its_border_has_no_cells(
    height_px: int, cells: int, *, turned: bool
) -> None:
    size_px = (height_px, 640) if turned else (640, height_px)
    assert FrontEndConfig(levels=2, border_px=20).count_cells(*size_px, 32) == cells


@pytest.mark.parametrize(
    ("given", "size_px", "cell_px", "per_cell"),
    [
        ({"cell_px": 128}, (640, 480), 128, 8), ({"per_cell": 8}, (640, 480), 64, 8),
        ({"per_cell": 2}, (640, 480), 32, 2),
        # One per cell is enough if the size of the cells is given.
        ({"cell_px": 32}, (1600, 900), 32, 1), ({"cell_px": 32, "per_cell": 5}, (640, 480), 32, 5),
    ],
)  # fmt: skip
def test_given_cells_stay(given: dict[str, Any], size_px: tuple[int, int], cell_px: int, per_cell: int) -> None:
    config = FrontEndConfig(**given).for_size(*size_px)
    assert (config.cell_px, config.per_cell) == (cell_px, per_cell)


def test_given_cells_that_do_not_fit_are_refused() -> None:
    with pytest.raises(ValueError, match="1920x1080: no cell size keeps the features within 2048; use a larger"):
        FrontEndConfig(cell_px=32, per_cell=5).for_size(1920, 1080)


@pytest.mark.parametrize("size_px", [(63, 480), (640, 63), (4097, 480), (640, 4097)])
def test_a_frame_size_out_of_range_is_refused(size_px: tuple[int, int]) -> None:
    with pytest.raises(ValueError, match="it must be a whole number from 64 to 4096"):
        FrontEndConfig().for_size(*size_px)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"levels": True}, "levels is True; valid: 1, 2"),
        ({"smoothed_gradients": 1}, "smoothed_gradients is 1; valid: true, false"),
        ({"smoothed_gradients": False}, "tensor_window_px without smoothed_gradients is 5; valid: 3"),
        ({"threshold": 2.5}, "threshold is 2.5; it must be a whole number from 1 to 1073741823"),
        ({"selection": False}, "selection is False, but two levels are ordered by cells; set levels = 1"),
        ({"selection": False, "levels": 1, "per_cell": 3}, "selection is False, but cell_px or per_cell is set"),
        ({"selection": False, "levels": 1, "cell_px": 32}, "selection is False, but cell_px or per_cell is set"),
    ],
)
def test_impossible_values_are_named(values: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        FrontEndConfig(**values)


@pytest.mark.parametrize(
    ("field", "low", "high", "others"),
    [
        ("threshold", 1, (1 << 30) - 1, {}),
        ("threshold", 1, 254, {"detector": "fast"}),
        ("harris_k_shift", 0, 15, {"harris_k_numerator": 0}),
        ("harris_k_numerator", 0, 3, {}),
        ("harris_k_numerator", 0, 0, {"harris_k_shift": 2}),
        ("harris_k_numerator", 0, 31, {"harris_k_shift": 15}),
        ("border_px", 20, 255, {}),
        ("border_px", 7, 255, {"descriptor": "thesis-ilbp-4", "tensor_window_px": 3, "smoothed_gradients": False}),
        ("max_features", 16, 4096, {}),
        ("per_cell", 1, 8, {}),
    ],
)
def test_every_whole_number_has_a_lowest_and_a_highest_value(
    field: str, low: int, high: int, others: dict[str, Any]
) -> None:
    for value in (low, high):
        assert getattr(FrontEndConfig(**others | {field: value}), field) == value
    refused: tuple[Any, ...] = (low - 1, high + 1, float(low), True)
    for value in refused:
        with pytest.raises(ValueError, match=f"^{field} is {value}; it must be a whole number from {low} to {high}$"):
            FrontEndConfig(**others | {field: value})


@pytest.mark.parametrize(
    ("field", "valid"),
    [
        ("detector", DETECTORS), ("levels", (1, 2)), ("smoothed_gradients", (True, False)),
        ("tensor_window_px", (3, 5)),
        ("suppression_radius_px", (1, 3)), ("selection", (True, False)), ("cell_px", (32, 64, 128, 256)),
        ("descriptor", tuple(PATTERNS)),
    ],
)  # fmt: skip
def test_every_choice_takes_its_values_and_no_other(field: str, valid: tuple[object, ...]) -> None:
    others: dict[str, Any] = {"levels": 1, "tensor_window_px": 3}
    for value in valid:
        assert getattr(FrontEndConfig(**others | {field: value}), field) == value
    with pytest.raises(ValueError, match=f"^{field} is 'x'; valid: {', '.join(map(str, valid)).lower()}$"):
        FrontEndConfig(**others | {field: "x"})


def test_matches_are_kept_above_a_weight_of_8_bits() -> None:
    for value in (0, 255):
        assert MatcherConfig(keep_above=value).keep_above == value
    refused: tuple[Any, ...] = (-1, 256, 1.0)
    for value in refused:
        with pytest.raises(ValueError, match=f"keep_above is {value}; it must be a whole number from 0 to 255"):
            MatcherConfig(keep_above=value)
    with pytest.raises(ValueError, match="rule_base is 'x'; valid: aerial, ilbp, none"):
        MatcherConfig(rule_base="x")


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
WRITTEN = {
    "aerial": "detector = 'harris' levels = 2 smoothed_gradients = true tensor_window_px = 5 harris_k_numerator = 1 "
    "harris_k_shift = 4 threshold = 2 suppression_radius_px = 3 border_px = 20 selection = true max_features = 2048 "
    "descriptor = 'ilbp-128' [matcher] rule_base = 'aerial' keep_above = 64",
    "thesis": "detector = 'harris' levels = 1 smoothed_gradients = false tensor_window_px = 3 harris_k_numerator = 5 "
    "harris_k_shift = 7 threshold = 1000 suppression_radius_px = 1 border_px = 7 selection = false max_features = 2048 "
    "descriptor = 'thesis-ilbp-4' [matcher] rule_base = 'ilbp' keep_above = 127",
}


@pytest.mark.parametrize("name", PRESETS)
def test_presets_have_the_numbers_with_which_results_were_measured(name: str) -> None:
    written = " ".join(to_toml(PRESETS[name]).replace('"', "'").split())
    assert written == f"preset = '{name}' [front_end] {WRITTEN[name]}"


@given(config=configs)
def test_toml_round_trip_is_exact(tmp_path_factory: pytest.TempPathFactory, config: Any) -> None:
    path = tmp_path_factory.getbasetemp() / "config.toml"
    path.write_text(to_toml(config))
    assert load_config(path) == config


def test_file_changes_a_preset(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    # Windows' editors begin a file with a mark.
    path.write_text("[front_end]\nthreshold = 9\n", encoding="utf-8-sig")
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
