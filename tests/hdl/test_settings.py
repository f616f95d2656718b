import re
import subprocess
import sys

import pytest

from golden_model.config import PRESETS, FrontEndConfig
from hdl.registers.register_map import ESTIMATOR_REGISTERS, REGISTERS, Access, Field, Register, fields
from hdl.registers.shell_register_map import ALL_REGISTERS
from hdl.settings import (
    ESTIMATION,
    FRONT_END,
    MIN_SLOTS,
    PAGE_BYTES,
    SETTINGS,
    TICK_CLOCKS,
    estimator_settings,
    frame_settings,
    matched_frame_settings,
)
from hdl.streams import FRONT_END_SETTINGS
from sim.simulators import stages
from tests.hdl.shell.bench import RINGS


def test_builds_and_settings_are_known_without_amaranth() -> None:
    script = "import hdl.build, hdl.settings, sys; sys.exit('amaranth' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", script], check=False).returncode == 0


def written(*registers: Register) -> dict[str, Field]:
    return {field.name: field for field in fields(Access.SETTING, registers=registers)}


def test_every_setting_has_one_register_field_that_holds_its_values() -> None:
    placed = written(*ALL_REGISTERS)
    assert len(placed) == len(list(fields(Access.SETTING, registers=ALL_REGISTERS)))
    assert all(0 <= field.init < 1 << field.bits and field.values[-1] < 1 << field.bits for field in placed.values())
    for setting in SETTINGS.values():
        field = placed[setting.name]
        assert (field.bits, field.values, field.init) == (setting.bits, setting.values, setting.reset)
    assert SETTINGS.keys() - {setting.name for setting in ESTIMATION} < written(*REGISTERS).keys()
    assert {setting.name for setting in ESTIMATION} < written(*ESTIMATOR_REGISTERS).keys()


def test_struct_and_ports_of_the_front_end_have_its_settings_in_order() -> None:
    expected = [(setting.name, setting.bits) for setting in FRONT_END]
    assert [(name, field.width) for name, field in FRONT_END_SETTINGS] == expected
    assert list(stages.SETTINGS.items()) == expected


LARGEST = {
    "cell_log2": 8, "per_cell": 8, "threshold_code": 32767, "target_features": 8191, "keep_above": 255, "passes": 255,
    "min_inliers": 4095, "min_cells": 64, "painter_max_links": 255, "coalesce_count": 255, "canvas_columns": 128,
    "canvas_rows": 128, "painter_hold_row": 127, "picture_lines": 4096, "picture_border": 0xFFFFFF,
    "frames_buffer_pages": 1048575, "pose_frame": 65535,
    "camera_timeout": 65535, "coalesce_timeout": 65535, "width_px": 4096, "height_px": 4096,
    **{f"{ring}_slots": 256 for ring in RINGS}, **{f"{ring}_slot_pages": 4096 for ring in RINGS},
}  # fmt: skip
SMALLEST = {"width_px": 64, "height_px": 64, "cell_log2": 5, "per_cell": 1}
RESETS = {
    "width_px": 640, "height_px": 480, "cell_log2": 5, "per_cell": 5, "threshold_code": 2, "target_features": 1024,
    "keep_above": 64, "passes": 32, "seed": 0x9E3779B9, "min_inliers": 12, "min_cells": 5, "painter_max_links": 255,
    "camera_timeout": 15_000, "coalesce_count": 1,
}  # fmt: skip
"""All others are 0."""
WORDS = r"seed|\w+_base_(low|high)|\w+_read|pose_h[0-2]{2}"


def test_settings_start_with_the_values_of_the_manual_and_take_those_that_drivers_check() -> None:
    """The rest are flags. Registers may be wider than the largest value."""
    placed = written(*ALL_REGISTERS)
    for name, field in placed.items():
        largest = LARGEST.get(name, 2**32 - 1 if re.fullmatch(WORDS, name) else 1)
        assert (name, field.values) == (name, range(SMALLEST.get(name, 0), largest + 1))
        assert (name, field.init) == (name, RESETS.get(name, 0))
    assert {*LARGEST, *SMALLEST, *RESETS} <= placed.keys()
    assert (PAGE_BYTES, MIN_SLOTS, TICK_CLOCKS) == (4096, 2, 1024)


@pytest.mark.parametrize(
    ("preset", "size_px", "others"),
    [
        ("aerial", (640, 480), {"cell_log2": 5, "per_cell": 5, "threshold_code": 2, "keep_above": 64}),
        ("aerial", (1920, 1080), {"cell_log2": 6, "per_cell": 3, "threshold_code": 2, "keep_above": 64}),
        ("thesis", (64, 70), {"cell_log2": 5, "per_cell": 1, "threshold_code": 1000, "keep_above": 127}),
    ],
)
def test_a_configuration_becomes_these_settings(preset: str, size_px: tuple[int, int], others: dict[str, int]) -> None:
    for gray_input in (False, True):
        assert matched_frame_settings(PRESETS[preset], *size_px, gray_input=gray_input) == {
            "width_px": size_px[0], "height_px": size_px[1], "detector": 0, "memory_mode": 0, "gray_input": gray_input,
            "adaptive": 0, "target_features": 2047, **others,
        }  # fmt: skip
    fast = FrontEndConfig(detector="fast", threshold=20)
    assert frame_settings(fast, *size_px, gray_input=True)["detector"] == 1
    assert estimator_settings(PRESETS[preset]) == {}
