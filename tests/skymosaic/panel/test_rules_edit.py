"""Edited rules decide as a new run with them would, and every change can be taken back."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from golden_model.fuzzy.rules import MatchRules, read_shipped
from sim.scene import make_pair
from skymosaic import register
from skymosaic.panel.options import OWN, Options
from skymosaic.panel.results import MosaicResult
from skymosaic.panel.rules_edit import RulesEdit, find_corners, move_corner
from skymosaic.panel.tasks.mosaic_tasks import make_mosaic
from tests.skymosaic.panel import made_up

AERIAL = read_shipped("aerial")
STRICT = AERIAL.replace("Ramp 0.34 0.1\n", "Ramp 0.2 0.1\n").replace("Ramp 0.1 0.34\n", "Ramp 0.1 0.2\n")
NAMES = ["0.png", "1.png"]


def run(folder: Path, preset: str = "aerial") -> MosaicResult:
    (folder / "pictures").mkdir()
    for name, image in zip(NAMES, make_pair(seed=9, size=(320, 240)).images, strict=True):
        for path in (folder / name, folder / "pictures" / f"{name}.png"):
            cv2.imwrite(str(path), image)
    options = Options.of_preset(preset)
    return make_mosaic(folder, NAMES, options, folder / "pictures", progress=lambda *_: None)


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> MosaicResult:
    return run(tmp_path_factory.mktemp("run"))


@pytest.fixture
def edit(result: MosaicResult) -> RulesEdit:
    return RulesEdit(result)


def test_edited_rules_decide_as_a_new_run_with_them(result: MosaicResult, edit: RulesEdit) -> None:
    edit.change(STRICT)
    left, right = (result.folder / name for name in NAMES)
    pair = register(left, right, rules=MatchRules(STRICT))
    np.testing.assert_array_equal(edit.pair.matches, pair.matches)
    assert edit.pair.summary()["confidence"] == pair.summary()["confidence"]
    assert edit.pair.summary()["rules_digest"] == pair.summary()["rules_digest"]
    assert 0 < len(edit.pair.kept) < len(result.pair.kept)
    assert (edit.pair.left.name, edit.pair.right.name) == (result.pair.left.name, result.pair.right.name)
    assert (result.folder / "edited_rules.fll").read_text() == STRICT


def test_a_change_is_taken_back_and_a_fault_changes_nothing(result: MosaicResult, edit: RulesEdit) -> None:
    edit.change(STRICT)
    strict = edit.pair
    edit.change(STRICT.replace("Ramp 0.2 0.1", "Ramp 0.2 nan"))
    assert "line 8: term low: a parameter is not a number" in edit.fault
    assert (edit.pair, edit.rules.text) == (strict, STRICT)
    edit.undo()
    assert (edit.fault, edit.rules.text) == ("", STRICT)
    edit.undo()
    np.testing.assert_array_equal(edit.pair.matches, result.pair.matches)
    assert (edit.rules.text, edit.versions) == (AERIAL, 1)
    edit.undo()
    assert edit.versions == 1
    edit.change(STRICT)
    edit.reset()
    assert (edit.rules.text, edit.versions) == (AERIAL, 3)


def test_the_steps_of_a_drag_are_one_version(edit: RulesEdit) -> None:
    for position in (0.3, 0.25, 0.2):
        edit.change(move_corner(AERIAL, 0, 0, position, 0), after=1)
    assert edit.versions == 2
    assert MatchRules(STRICT).system == edit.rules.system
    edit.change(move_corner(AERIAL, 0, 0, 0.34, 0), after=1)
    assert edit.versions == 1


def test_the_terms_of_a_product_move_together() -> None:
    corners = find_corners(MatchRules(AERIAL).system, 0)
    assert [(corner.x, corner.y, corner.members) for corner in corners] == [
        (0.34, 0.0, (("low", 0), ("high", 1))),
        (0.1, 1.0, (("low", 1), ("high", 0))),
    ]
    moved = move_corner(AERIAL, 0, 1, 0.1521, 0.3)
    assert moved == AERIAL.replace("Ramp 0.34 0.1\n", "Ramp 0.34 0.15\n").replace("Ramp 0.1 0.34\n", "Ramp 0.15 0.34\n")


def test_points_move_in_both_directions_and_terms_of_a_minimum_alone() -> None:
    moved = move_corner(AERIAL, 2, 2, 2.49, 0.4)
    assert "common Discrete 0 1 1 1 2.48 0.4 3 0.2 4 0\n" in moved
    assert "other Discrete 0 0 1 0 2.48 0.6 3 0.8 4 1\n" in moved
    assert MatchRules(moved).tables(128)
    text = AERIAL.replace("AlgebraicProduct", "Minimum")
    assert len(find_corners(MatchRules(text).system, 0)) == 4
    moved = move_corner(text, 0, 0, 0.5, 0)
    assert moved == text.replace("low Ramp 0.34 0.1", "low Ramp 0.5 0.1")


def test_rules_are_edited_where_they_decide(tmp_path: Path) -> None:
    with_rules = made_up.pair_result(tmp_path)
    without = made_up.pair("a.png", "b.png", Options.of_preset("aerial").changed("rules", "none"))
    assert RulesEdit.applies_to(with_rules)
    assert not RulesEdit.applies_to(replace(with_rules, pair=without))
    assert not RulesEdit.applies_to(made_up.flight_result(tmp_path))


def test_own_rules_are_an_option_until_another_name_is_chosen() -> None:
    options = Options.of_preset("aerial").changed("rules", MatchRules(STRICT))
    assert options.shown("rules") == OWN
    # The page's list shows "own", which changes nothing.
    assert options.changed("rules", OWN) is options
    assert options.base_config.matcher.rules == MatchRules(STRICT)
    assert options.changed("rules", "aerial") == Options.of_preset("aerial")
