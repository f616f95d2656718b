"""Configuration files: reading and writing TOML."""

import dataclasses
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from golden_model.config import PRESETS, Config, FrontEndConfig, MatcherConfig
from golden_model.config_file import load_config, to_toml
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
