"""The doubt of a pair rises with whatever speaks against it, and its verdict names the strongest cause."""

import itertools
import json
from collections.abc import Callable
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from golden_model.arrays import Pixels
from sim.scene import CameraPose
from skymosaic import register
from skymosaic.common.errors import InputError
from skymosaic.geometry.ground import Sight, count_agreeing, lay_over
from skymosaic.geometry.homography import apply
from skymosaic.registration.confidence import TABLE, Evidence, judge, measure_evidence, read_table
from skymosaic.registration.pair import Pair
from tests.skymosaic.registration.rendering import CAMERA, view

BEST = Evidence(
    inliers=500, held_out_share=1, held_out_px=0.8, hull_share=1, motion=0.1, ground_share=1, ground_lack=0, rival=0
)
WORST: dict[str, Any] = dict.fromkeys(("held_out_share", "hull_share", "motion", "ground_share"), 0.0)
WORST |= {"inliers": 8, "ground_lack": 0.7, "rival": 1.2}


def view_at(x_px: int, seed: int) -> Pixels:
    """What the camera sees from 384 px above the ground, so that ``x_px`` moves the picture by as many pixels."""
    return view(CameraPose(x_px=x_px, y_px=40, altitude_px=384), seed)


@pytest.fixture(scope="module")
def left() -> Pixels:
    return view_at(60, seed=0)


@pytest.mark.parametrize("name", WORST)
def test_each_input_speaks_against_a_pair_and_none_for_it(name: str) -> None:
    assert read_table().inputs.keys() == WORST.keys()
    steps = [replace(BEST, **{name: value}) for value in np.linspace(getattr(BEST, name), WORST[name], 9)]
    trusts = [judge(each, 640) for each in steps]
    for field in ("doubt", "predicted_px"):
        values = [getattr(trust, field) for trust in trusts]
        assert values == sorted(values)
    assert trusts[0].verdict == "good"
    assert trusts[-1].doubt > trusts[0].doubt


@pytest.mark.parametrize(
    ("worst", "said"),
    [
        ((), "100 % of held-out matches within 2 px; expected error "),
        (("held_out_share",), "0 % of held-out matches within 2 px; "),
        (("hull_share",), "inliers cover 0 % of the overlap; "),
        (("motion",), "the camera moved by only 0.00 % of the picture: it stands on a tripod, or "),
        (("ground_share",), "0 % of the ground agrees; "),
        (("ground_lack",), "70 % of the ground more should agree for a camera that moved by 10 % of the picture: "),
        (("rival",), "the ground repeats itself: it fits elsewhere 1.20 times as well; "),
    ],
)
def test_the_verdict_has_its_strongest_cause(worst: tuple[str, ...], said: str) -> None:
    trust = judge(replace(BEST, **({"inliers": 200, "hull_share": 0.8} | {name: WORST[name] for name in worst})), 640)
    assert trust.reason.startswith(said)
    assert trust.reason.endswith(" px at a width of 640 px")
    assert worst or trust.verdict == "good"


def test_everything_against_a_pair_refuses_it_and_all_numbers_are_told() -> None:
    trust = judge(replace(BEST, **WORST), 640)
    assert (trust.verdict, trust.is_refused) == ("poor", True)
    assert trust.doubt > 0.99
    told = trust.summary()
    assert told.keys() == {"verdict", "reason", "predicted_px", "doubt", *asdict(BEST)}
    assert {name: told[name] for name in WORST} == WORST


def test_what_is_rather_wrong_than_right_is_refused_and_delivered_on_request(
    left: Pixels, monkeypatch: pytest.MonkeyPatch
) -> None:
    right = view_at(280, seed=3)
    monkeypatch.setattr("skymosaic.registration.confidence.MAX_DOUBT", -1.0)
    refused, delivered = (register(left, right, effort="fast", accept_poor=poor) for poor in (False, True))
    assert not refused.accepted
    assert "expected error" in refused.reason
    assert "`accept_poor`" in refused.reason
    assert delivered.accepted


@pytest.mark.parametrize(("moved_px", "lacks"), [(2, True), (40, False)])
def test_what_cannot_tell_lacks_where_the_camera_stood_still(moved_px: int, lacks: bool) -> None:
    picture, points = np.full((480, 640), 90, np.uint8), np.random.default_rng(0).uniform(0, 400, (60, 2))
    picture[100:260, 100:400] = np.random.default_rng(1).integers(0, 255, (20, 38)).repeat(8, 0).repeat(8, 1)[:, :300]
    moved = np.roll(picture, moved_px, axis=1)
    shift = np.array([[1.0, 0, moved_px], [0, 1, 0], [0, 0, 1]])
    evidence = measure_evidence((Sight(picture), Sight(moved)), shift, points, points + np.array([moved_px, 0]))
    assert evidence.ground_share > 0.9
    assert (evidence.ground_lack > 0.4) is lacks


def test_pictures_without_texture_neither_agree_nor_disagree() -> None:
    picture, points = np.full((480, 640), 90, np.uint8), np.random.default_rng(0).uniform(0, 400, (60, 2))
    shift = np.array([[1.0, 0, 40], [0, 1, 0], [0, 0, 1]])
    evidence = measure_evidence((Sight(picture), Sight(picture)), shift, points, points + np.array([40, 0]))
    assert (evidence.ground_share, evidence.ground_lack) == (0.5, 0)
    assert evidence.rival == 0


@pytest.mark.parametrize(("moved_px", "agrees"), [(0, True), (96, False)])
def test_watermarks_that_lie_on_each_other_a_period_away_are_no_ground(
    left: Pixels, moved_px: int, agrees: bool
) -> None:
    """Of two places; without motion, `motion` speaks against them."""
    marked = [left.copy(), view_at(900, seed=5)]
    for image, x, y in itertools.product(marked, range(0, CAMERA.width_px, 96), range(20, CAMERA.height_px, 32)):
        cv2.putText(image, "SAMPLE", (x, y), cv2.FONT_HERSHEY_TRIPLEX, 0.7, (255, 255, 255), 2)
    sights = Sight(marked[0]), Sight(marked[1])
    shift = np.array([[1.0, 0, moved_px], [0, 1, 0], [0, 0, 1]])
    points = np.random.default_rng(0).uniform(0, 300, (60, 2))
    assert count_agreeing(lay_over(480, *sights, shift)).share > 0.4
    evidence = measure_evidence(sights, shift, points, points + np.array([moved_px, 0]))
    assert (evidence.ground_share > 0.4) is agrees
    assert (evidence.ground_share < 0.2) is not agrees
    # Pictures of two sizes are of two cameras, and have no watermark in common.
    taller = cv2.copyMakeBorder(marked[1], 0, 16, 0, 0, cv2.BORDER_REFLECT)
    assert measure_evidence((sights[0], Sight(taller)), shift, points, points).ground_share > 0.4


def test_ground_around_the_middle_of_a_turn_is_ground(left: Pixels) -> None:
    """There, it agrees at the same pixels as well; elsewhere, a fifth of it has changed."""
    size = CAMERA.width_px, CAMERA.height_px
    turn = np.vstack([cv2.getRotationMatrix2D((size[0] / 2, size[1] / 2), 1.5, 1.0), [0, 0, 1]])
    turned = np.asarray(cv2.warpPerspective(left, turn, size, borderMode=cv2.BORDER_REFLECT), np.uint8)
    turned[:, : size[0] // 5] = left[::-1, : size[0] // 5]
    points = np.random.default_rng(0).uniform(0, 300, (60, 2))
    evidence = measure_evidence((Sight(left), Sight(turned)), turn, points, apply(turn, points))
    assert evidence.ground_lack == 0
    assert evidence.ground_share > 0.7


@pytest.mark.parametrize(
    ("damage", "said"),
    [
        (lambda text: text[: len(text) // 2], "damaged"),
        (lambda text: text.replace('"format": 1', '"format": 2'), "version 2"),
        (lambda text: json.dumps(json.loads(text) | {"inputs": {"rival": {"at": [0]}}}), "damaged"),
    ],
    ids=["cut off", "of another version", "without a column"],
)
def test_a_damaged_table_is_told_by_name(tmp_path: Path, damage: Callable[[str], str], said: str) -> None:
    path = tmp_path / "table.json"
    path.write_text(damage(TABLE.read_text()))
    with pytest.raises(InputError, match=said) as error:
        read_table(path)
    assert str(path) in str(error.value)


def test_a_mirrored_picture_and_pictures_without_texture_are_refused(left: Pixels) -> None:
    nothing: Any = np.full_like(left, 120)
    for one, other in ((left, left[:, ::-1].copy()), (nothing, nothing), (left, nothing)):
        pair: Pair = register(one, other)
        assert not pair.accepted
        assert pair.reason
