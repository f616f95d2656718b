"""The options, and the method and configuration they resolve to."""

import itertools

import httpx
import pytest

from skymosaic.common.errors import InputError
from skymosaic.panel.options import LABELLED, OPTION_VALUES, SCALES, STRONGEST, Options, SliderScale, fault_of


@pytest.mark.parametrize("slider", [*SCALES.values(), STRONGEST], ids=lambda slider: slider.title)
def test_slider_values_rise_and_convert_back_to_positions(slider: SliderScale) -> None:
    values = list(slider.values.values())
    assert list(slider.values) == list(range(min(slider.values), max(slider.values) + 1))
    assert values == sorted(values)
    assert values[0] >= 1
    assert all(slider.values[slider.position(value)] == value for value in values)


@pytest.mark.parametrize(
    ("slider", "lowest", "second", "highest"),
    [
        (SCALES["harris"], (19, 2), 1024, (48, 1 << 24)),
        (SCALES["fast"], (1, 1), 2, (120, 120)),
        (STRONGEST, (14, 128), 181, (22, 2048)),
    ],
    ids=lambda value: value.title if isinstance(value, SliderScale) else "",
)
def test_a_slider_has_a_value_at_each_position(
    slider: SliderScale, lowest: tuple[int, int], second: int, highest: tuple[int, int]
) -> None:
    values = [*slider.values.items()]
    assert (values[0], values[1][1], values[-1]) == (lowest, second, highest)
    # A value between two positions is at the upper one, and one beyond all at the last.
    assert [slider.position(each) for each in (0, lowest[1] + 1, 1 << 30)] == [lowest[0], lowest[0] + 1, highest[0]]


def test_options_begin_as_the_preset_has_them() -> None:
    aerial = Options.of_preset("aerial")
    shown = {name: aerial.shown(name) for name in LABELLED}
    assert [*shown][-1] == "damaged"
    assert (shown["rules"], shown["blending"], shown["backend"], aerial.position) == (
        "aerial",
        "automatic",
        "golden",
        19,
    )
    assert [aerial.changed("detector", name).position for name in ("fast", "sift")] == [10, 22]
    multiband = aerial.changed("blending", "multiband")
    assert multiband.changed("blending", "automatic") == aerial
    # No photograph, one, or two.
    assert [fault_of(aerial, count) for count in range(3)] == ["", "", ""]
    board = aerial.changed("backend", "board:pynq:5000")
    assert (board.backend, board.address, board.shown("backend")) == ("board", "pynq:5000", "board:pynq:5000")
    assert (board.changed("backend", "rtl").address, aerial.address) == (None, None)


@pytest.mark.parametrize("preset", OPTION_VALUES["preset"])
def test_a_preset_resolves_to_its_own_configuration(preset: str) -> None:
    options = Options.of_preset(preset)
    _, config = options.choose_method()
    assert config.preset == preset
    assert options.slider_scale.values[options.position] >= config.front_end.threshold


def test_every_combination_of_options_resolves_or_is_refused_with_a_reason() -> None:
    lists = (OPTION_VALUES[name] for name in ("preset", "detector", "descriptor", "rules"))
    reasons = [_why_refused(*combination) for combination in itertools.product(*lists)]
    assert reasons.count("") > 200
    assert "another method" not in reasons
    assert not any("\n" in reason for reason in reasons)


def _why_refused(preset: str, detector: str, descriptor: str, rules: str) -> str:
    options = Options.of_preset(preset).changed("detector", detector).changed("descriptor", descriptor)
    try:
        method, _ = options.changed("rules", rules).choose_method()
    except InputError as error:
        return str(error)
    return "" if (method.detector, method.descriptor) == (detector, descriptor) else "another method"


def test_the_slider_sets_the_front_ends_threshold_or_number() -> None:
    harris = Options.of_preset("aerial").changed("position", 20)
    assert harris.choose_method()[1].front_end.threshold == 1024
    strongest = harris.changed("detector", "sift").changed("position", 16)
    assert strongest.choose_method()[1].front_end.max_features == 256


def test_a_preset_resets_all_options() -> None:
    changed = Options.of_preset("aerial").changed("detector", "fast").changed("descriptor", "ilbp-256")
    assert changed.changed("preset", "thesis") == Options.of_preset("thesis")


def test_a_flight_has_fewer_options_than_a_pair() -> None:
    aerial = Options.of_preset("aerial")
    assert fault_of(aerial, 3) == fault_of(aerial.changed("detector", "fast"), 3) == ""
    for name, value in (("detector", "sift"), ("estimator", "magsac"), ("accept_poor", True)):
        changed = aerial.changed(name, value)
        assert fault_of(changed) == ""
        assert "keep only two photographs" in fault_of(changed, 3)
    # By the names that the page shows.
    assert fault_of(aerial.changed("estimator", "magsac"), 3).startswith("Estimator magsac: ")
    assert fault_of(aerial.changed("accept_poor", True), 3).startswith("Deliver a poor pair: ")


def test_a_backend_that_does_not_compute_the_method_is_refused() -> None:
    simulated = Options.of_preset("aerial").changed("backend", "rtl")
    assert fault_of(simulated) == ""
    assert "computes only harris, fast" in fault_of(simulated.changed("detector", "orb"))


def test_a_board_is_offered_as_a_backend(owner_address: str, silent_board: str) -> None:
    with httpx.Client(base_url=owner_address.partition("?")[0], timeout=None) as owner:
        owner.get(owner_address)
        for path in ("/", "/tracking"):
            assert f"board:{silent_board}" in owner.get(path).text
