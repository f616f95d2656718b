import dataclasses

import pytest

from golden_model.config import PRESETS, EstimatorConfig, MatcherConfig
from golden_model.fuzzy.rules import MatchRules, read_shipped
from golden_model.version import VERSION
from hdl.build import BUILDS, Build
from hdl.registers.register_map import Access, built_constants, fields, register_writes


def test_a_word_is_written_whole_with_the_initial_values_of_its_other_fields() -> None:
    assert register_writes({"height_px": 100, "enable": 1, "gray_input": 1}) == [(0x20, 0b101), (0x28, 640 | 100 << 16)]
    assert register_writes({}) == []


def test_a_field_that_does_not_exist_is_named() -> None:
    with pytest.raises(ValueError, match=r"no register field treshold$"):
        register_writes({"treshold": 7, "enable": 1})
    with pytest.raises(ValueError, match=r"no register field seed$"):
        register_writes({"seed": 1})


def test_the_constants_say_what_was_built_and_fit_their_fields() -> None:
    thesis = dataclasses.replace(PRESETS["thesis"], estimator=EstimatorConfig())
    paints = dataclasses.replace(BUILDS["camera"], config=thesis, painter=True, lanes=8, max_width_px=1600)
    for build in (*BUILDS.values(), paints, Build(config=thesis, lanes=2, max_width_px=160, max_height_px=120)):
        constants = built_constants(build)
        masks = {field.name: field.mask >> field.low for field in fields(Access.CONSTANT)}
        assert constants.keys() == masks.keys()
        assert all(0 <= value <= masks[name] for name, value in constants.items())
        version = ".".join(str(constants[f"version_{part}"]) for part in ("major", "minor", "patch"))
        assert version == VERSION
    rules_digest = thesis.matcher.rules_digest(thesis.front_end.pattern)
    described = {name: value for name, value in built_constants(paints).items() if not name.startswith("version")}
    assert described == {
        "identity": 0x534B594D, "built_levels": 1, "built_detectors": 0b11, "built_rule_base": 1,
        "built_rules_digest": rules_digest, "built_selection": 0, "built_shell": 1, "built_homographies": 1,
        "built_painter": 1, "built_descriptor_bytes": 4, "built_lanes": 8, "built_video_bits": 24,
        "built_width_px": 1600, "built_height_px": 1080, "built_max_features": 2048, "built_feature_bytes": 32,
        "built_match_bytes": 24,
    }  # fmt: skip
    own = dataclasses.replace(thesis, matcher=MatcherConfig(rule_base=MatchRules(read_shipped("aerial"))))
    others = [Build(), Build(config=dataclasses.replace(PRESETS["aerial"], matcher=own.matcher)), BUILDS["ulx3s"]]
    names = ("levels", "rule_base", "selection", "shell", "homographies", "painter")
    found = [tuple(built_constants(build)[f"built_{name}"] for name in names) for build in others]
    assert found == [(2, 0, 1, 0, 0, 0), (2, 3, 1, 0, 0, 0), (1, 0, 1, 0, 0, 0)]
