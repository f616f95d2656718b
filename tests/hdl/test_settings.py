import dataclasses
import subprocess
import sys

import pytest

from golden_model.config import PRESETS, EstimatorConfig
from hdl.registers.register_map import REGISTERS, Access, fields
from hdl.registers.shell_register_map import ALL_REGISTERS
from hdl.settings import (
    ESTIMATOR,
    FRONT_END,
    REQUESTED,
    RUNNING,
    SETTINGS,
    SHELL,
    estimator_settings,
    frame_settings,
    matched_frame_settings,
)
from hdl.streams import FRONT_END_SETTINGS
from sim.simulators import front_end_top


def test_the_settings_load_without_amaranth() -> None:
    script = "import hdl.settings, sys; sys.exit('amaranth' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", script], check=False).returncode == 0


def test_every_setting_has_one_register_field_that_holds_its_values() -> None:
    for settings, registers in ((SETTINGS, REGISTERS), (SETTINGS | ESTIMATOR | SHELL, ALL_REGISTERS)):
        placed = {field.name: (field.bits, field.init) for field in fields(Access.SETTING, registers=registers)}
        assert placed == {setting.name: (setting.bits, setting.reset) for setting in settings.values()}
        assert all(0 <= setting.reset < 1 << setting.bits for setting in settings.values())


def test_struct_and_ports_of_the_front_end_have_its_settings_in_order() -> None:
    expected = [(setting.name, setting.bits) for setting in FRONT_END]
    assert [(name, field.width) for name, field in FRONT_END_SETTINGS] == expected
    assert list(front_end_top.SETTINGS.items()) == expected


@pytest.mark.parametrize("preset", PRESETS)
@pytest.mark.parametrize("size_px", [(64, 64), (640, 480), (1920, 1080)])
def test_settings_from_a_configuration_are_valid(preset: str, size_px: tuple[int, int]) -> None:
    config = PRESETS[preset]
    values = matched_frame_settings(config, *size_px, gray_input=True)
    assert all(value in SETTINGS[name].values for name, value in values.items())
    assert set(REQUESTED) <= set(values)
    assert set(RUNNING) <= set(SETTINGS)
    config = dataclasses.replace(config, estimator=EstimatorConfig())
    assert all(value in ESTIMATOR[name].values for name, value in estimator_settings(config).items())
    assert ESTIMATOR["min_cells"].values[-1] == 8 * 8
    assert set(frame_settings(config.front_end, *size_px, gray_input=True)) == {setting.name for setting in FRONT_END}
