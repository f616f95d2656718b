import dataclasses

import pytest

from golden_model.config import PRESETS, EstimatorConfig
from golden_model.version import VERSION
from hdl.build import BUILDS, Build
from hdl.registers.register_map import REGISTERS, Access, built_constants, fields, register_writes


def test_a_word_is_written_whole_with_the_initial_values_of_its_other_fields() -> None:
    assert register_writes({"height_px": 100, "enable": 1, "gray_input": 1}) == [
        (0x20, 0b101),
        (0x28, 640 | 100 << 16),
    ]
    assert register_writes({}) == []


def test_a_field_that_does_not_exist_is_named() -> None:
    with pytest.raises(ValueError, match=r"no register field treshold$"):
        register_writes({"treshold": 7, "enable": 1})
    with pytest.raises(ValueError, match=r"no register field seed$"):
        register_writes({"seed": 1})


def test_the_constants_say_what_was_built_and_fit_their_fields() -> None:
    thesis = dataclasses.replace(PRESETS["thesis"], estimator=EstimatorConfig())
    paints = dataclasses.replace(BUILDS["camera"], config=thesis, painter=True)
    for build in (*BUILDS.values(), paints, Build(config=thesis, lanes=2, max_width_px=160, max_height_px=120)):
        constants = built_constants(build)
        masks = {field.name: field.mask >> field.low for field in fields(Access.CONSTANT)}
        assert constants.keys() == masks.keys()
        assert all(0 <= value <= masks[name] for name, value in constants.items())
        version = ".".join(str(constants[f"version_{part}"]) for part in ("major", "minor", "patch"))
        assert version == VERSION
        size = constants["built_width_px"], constants["built_height_px"]
        assert size == (build.max_width_px, build.max_height_px)
        assert (constants["built_lanes"], constants["built_video_bits"]) == (build.lanes, build.video_bits)
        pattern = build.config.front_end.pattern
        assert constants["built_descriptor_bytes"] == pattern.bits // 8
        assert constants["built_feature_bytes"] == pattern.record.dtype.itemsize
        assert constants["built_shell"] == (build.shell == "camera")
        assert constants["built_homographies"] == (build.config.estimator is not None)
        assert constants["built_painter"] == build.painter


def test_fields_are_found_by_their_access_in_the_order_of_the_map() -> None:
    found = list(fields(Access.EVENT, Access.COMMAND))
    assert [field.name for field in found] == ["clear", "frame_done", "matches_done", "frame_bad"]
    assert [field for register in REGISTERS for field in register.fields] == list(fields(*Access))
