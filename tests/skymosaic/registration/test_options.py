"""What a registration may be asked for, each part of a condition alone, and what follows from it."""

from typing import Any

import pytest

from golden_model.config import preset_config
from skymosaic.common.errors import InputError
from skymosaic.features.backends import load_backend
from skymosaic.features.methods import HostBackend, Method
from skymosaic.registration.options import RegistrationOptions, read_rules

SIFT, GOLDEN = HostBackend(Method("sift", "sift")), load_backend("golden")


@pytest.mark.parametrize(
    ("changes", "effort", "backend"),
    [
        ({}, "normal", "golden"),
        ({"effort": "fast"}, "fast", "golden"),
        ({"effort": "thorough"}, "thorough", "golden"),
        ({"estimator": "magsac"}, "fast", "golden"),
        ({"estimator": "magsac", "effort": "fast"}, "fast", "golden"),
        ({"estimator": "fuzzy-ransac", "rules": "none"}, "fast", "golden"),
        ({"descriptor": "ilbp-128-upright"}, "fast", "golden"),
        ({"preset": "thesis"}, "fast", "golden"),
        ({"detector": "sift", "descriptor": "ilbp-128", "rules": "aerial"}, "normal", "golden"),
        ({"detector": "sift"}, "fast", "golden"),
        ({"detector": "sift", "backend": SIFT}, "fast", "HostBackend"),
        ({"backend": GOLDEN}, "normal", "GoldenBackend"),
        ({"backend": "rtl"}, "normal", "rtl"),
        ({"backend": "board", "address": "here:7"}, "fast", "board:here:7"),
        ({"backend": "board", "address": "here", "effort": "fast"}, "fast", "board:here"),
        ({"seed": 0, "working_width_px": 64}, "normal", "golden"),
        ({"working_width_px": 4096}, "normal", "golden"),
    ],
)
def test_effort_and_backend_follow_from_what_is_asked(changes: dict[str, Any], effort: str, backend: str) -> None:
    options = RegistrationOptions(**changes)
    options.check()
    method, _ = options.choose_method()
    assert options.choose_effort(method) == effort
    assert options.backend_name == backend
    if options.backend not in ("board", "rtl"):
        opened = options.open_backend(method)
        assert type(opened).__name__ == ("GoldenBackend" if method.on_accelerator else "HostBackend")
        assert isinstance(options.backend, str) or opened is options.backend


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"backend": "board"}, "`backend` board: the address of the board is missing; give it with `address`"),
        ({"address": "here"}, "`address` here is for a board; choose `backend` board, or leave it out"),
        ({"backend": GOLDEN, "address": "here"}, "`address` here is for a board"),
        ({"detector": "sift", "backend": GOLDEN}, "`backend` GoldenBackend computes only harris, fast with ILBP"),
        ({"detector": "sift", "backend": "rtl"}, "sift with sift runs on the host; leave out `backend`"),
        ({"detector": "sift", "rules": "aerial"}, "`rules` decide matches of ILBP descriptors, not of sift"),
        ({"estimator": "fuzzy-ransac", "rules": "aerial"}, "`estimator` fuzzy-ransac has rules of its own"),
        ({"working_width_px": 4097}, "it must be at least 64 and at most 4096"),
        ({"rules": "mine"}, "`rules` is 'mine'"),
    ],
)
def test_what_does_not_go_together_is_refused(changes: dict[str, Any], says: str) -> None:
    with pytest.raises(InputError) as refused:
        RegistrationOptions(**changes).check()
    assert says in str(refused.value)


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        (
            {"detector": "sift", "effort": "normal"},
            "`effort` normal needs an oriented ILBP descriptor and the estimator",
        ),
        ({"preset": "thesis", "effort": "thorough"}, "`effort` thorough needs an oriented ILBP descriptor"),
        ({"estimator": "magsac", "effort": "normal"}, "`effort` normal needs .* and the estimator prosac"),
        (
            {"backend": "board", "address": "here", "effort": "normal"},
            "needs frames of several sizes, a board takes one",
        ),
    ],
)
def test_an_effort_with_further_passes_needs_what_they_need(changes: dict[str, Any], says: str) -> None:
    options = RegistrationOptions(**changes)
    with pytest.raises(InputError, match=says):
        options.choose_effort(options.choose_method()[0])


def test_rules_and_a_configuration_replace_those_of_the_preset() -> None:
    thesis = preset_config("thesis")
    assert RegistrationOptions(config=thesis).base_config == RegistrationOptions(preset="thesis").base_config == thesis
    given = RegistrationOptions(config=thesis, rules="none").base_config
    assert (given.matcher.rule_base, given.front_end) == ("none", thesis.front_end)
    assert [read_rules(name) for name in ("aerial", "ilbp", "none")] == ["aerial", "ilbp", "none"]
    with pytest.raises(InputError, match=r"`rules` is 'mine'; valid: aerial, ilbp, none, or an .fll or .fis file"):
        read_rules("mine")
    own = RegistrationOptions()
    assert (own.seed, own.working_width_px, own.accept_poor, own.damaged) == (0, 1280, False, "refuse")
    assert RegistrationOptions(damaged="keep").keeps_damaged > RegistrationOptions().keeps_damaged
