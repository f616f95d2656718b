"""Ground that lies on other ground: of photographs that are drawn, and of a rendered flight with a planted twin."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from golden_model.arrays import Array, Pixels
from sim.scene.flight import make_lawnmower
from sim.scene.ground import render_ground
from skymosaic.flight.layout.agreement import (
    MAX_COMPARED,
    MIN_RECOGNISED,
    Agreement,
    GroundOfPair,
    find_false_joint,
    measure_agreement,
)
from skymosaic.flight.linking.links import Link
from skymosaic.flight.linking.view import View
from skymosaic.mosaicking.api import open_run
from skymosaic.mosaicking.options import MosaicOptions
from tests.skymosaic.flight import made

SIZE, NEAR, COUNT = (480, 360), 5, 10


def photographs(twin: float) -> list[Pixels]:
    """A flight; with a twin, its second half is far away, and ground of that share of a photograph lies in both."""
    rendered = make_lawnmower(seed=2, images=COUNT, size=SIZE, forward_overlap=0.7, side_overlap=0.6)
    if not twin:
        return list(rendered.images)
    poses = [replace(pose, x_px=pose.x_px + 4000 * (view >= NEAR)) for view, pose in enumerate(rendered.poses)]
    away, images = replace(rendered, poses=tuple(poses)), list[Pixels]()
    width_px, height_px = (round(twin * side) for side in SIZE)
    both, shown = render_ground(77, width_px, height_px), np.full((height_px, width_px), 255, np.uint8)
    for view, image in enumerate(away.images):
        middle = poses[NEAR // 2 + NEAR * (view >= NEAR)]
        to_ground = np.array([[1, 0, middle.x_px - width_px / 2], [0, 1, middle.y_px - height_px / 2], [0, 0, 1]])
        to_image = away.homographies[view] @ to_ground
        inside = cv2.warpPerspective(shown, to_image, SIZE) == 255
        pasted = np.where(inside[..., None], cv2.warpPerspective(both, to_image, SIZE), image)
        images.append(np.asarray(pasted, np.uint8))
    return images


@pytest.mark.parametrize("twin", [0.35, 0.8])
def test_what_only_a_twin_joins_is_apart(twin: float) -> None:
    with open_run(photographs(twin), MosaicOptions()) as run:
        layouts, flight = run.layouts, run.flight
    assert [layout.members for layout in layouts] == [(0, 1, 2, 3, 4), (5, 6, 7, 8, 9)]
    assert any(link.holds and link.left < NEAR <= link.right for link in flight.links)
    assert all(not layout.agreement.of(False) for layout in layouts)
    reasons = list(flight.absent_from(layouts[0]).values())
    assert len({reason.partition(": ")[2] for reason in reasons}) == 1
    assert ") the ground contradicts: across them " in reasons[0]
    assert " pairs that overlap by half, and " in reasons[0]


def test_without_a_twin_all_pairs_agree() -> None:
    with open_run(photographs(twin=0), MosaicOptions()) as run:
        (layout,) = run.layouts
    assert len(layout.members) == COUNT
    assert not layout.agreement.of(False)
    assert len(layout.agreement.of(True)) > COUNT


def seen(*thumbnails: Pixels) -> list[View]:
    return [made.view(size=(640, 480), to_thumbnail=np.diag([0.5, 0.5, 1]), thumbnail=each) for each in thumbnails]


def noise(seed: int) -> Pixels:
    fine = np.random.default_rng(seed).normal(0, 1, (240, 400))
    return np.asarray(np.clip(128 + 200 * cv2.GaussianBlur(fine, (0, 0), 2), 0, 255), np.uint8)


def aside(*offsets_px: float) -> dict[int, Array]:
    return {view: np.array([[1.0, 0, at], [0, 1, 0], [0, 0, 1]]) for view, at in enumerate(offsets_px)}


def test_ground_agrees_differs_or_cannot_tell() -> None:
    ground, other, flat = noise(0), noise(1), np.full((240, 320), 90, np.uint8)
    # Views 0 to 2 show one ground, each 20 px of a thumbnail farther; 3 and 4 show another.
    views = seen(*(ground[:, at : at + 320] for at in (0, 20, 40)), other[:, :320], other[:, 20:340], flat)
    found = measure_agreement(views, aside(0, 40, 80, 0, 40, 0))
    assert found.of(True) == [(0, 1), (0, 2), (1, 2), (3, 4)]
    assert found.of(False) == [(left, right) for left in range(3) for right in (3, 4)]
    assert found.of(None) == [(view, 5) for view in range(5)]
    assert found.without({3, 4, 5}).pairs.keys() == {(0, 1), (0, 2), (1, 2)}


def test_agreement_is_recognised_within_reach() -> None:
    # As waves: full of texture, and different in each photograph.
    found = measure_agreement(seen(noise(2)[:, :320], noise(3)[:, :320]), aside(0, 0))
    assert (found.of(True), found.of(False), found.of(None)) == ([], [], [(0, 1)])
    views = seen(noise(0)[:, :320], noise(0)[:, 20:340])
    numbers = measure_agreement(views, aside(0, 40 + 12)).numbers
    assert (numbers["agree"], numbers["ninety_px"]) == (1, 12)
    assert measure_agreement(views, aside(0, 40 + 60)).numbers["agree"] == 0


def test_ground_that_repeats_itself_tells_nothing_by_what_is_the_same() -> None:
    facade = np.tile(noise(0)[:80, :80], (3, 5))
    other = cv2.addWeighted(facade, 0.85, noise(1), 0.15, 0)
    same, aside_by = (GroundOfPair(9, 9, 1.0, 0, each) for each in (False, True))
    assert (same.agrees, aside_by.agrees, replace(aside_by, same=1).agrees) == (True, None, False)
    assert replace(same, same=2, recognised=10).agrees
    found = measure_agreement(seen(facade[:, :320], other[:, 40:360], noise(0)[:, 20:340]), aside(0, 80, 40))
    assert found.repeated == found.of(None) == [(0, 1)]
    assert found.pairs[0, 1].same > 10
    # A road looks the same all along, but not aside; a strip is too thin to tell.
    across = np.where(abs(np.arange(240) - 120) < 20, 220, facade[0, 0]).astype(np.uint8)
    road = np.repeat(across[:, None], 320, axis=1)
    assert measure_agreement(seen(road, road), aside(0, 0)).repeated == []
    assert measure_agreement(seen(facade[:30, :320], facade[:30, :320]), aside(0, 0)).repeated == []


def test_what_is_different_amid_the_ties_has_changed() -> None:
    ground, now = noise(0)[:, :320], noise(0)[:, :320].copy()
    now[60:180, 100:220] = noise(1)[60:180, 100:220]
    views, corners = seen(ground, now, ground, now), np.array([(20.0, 20), (620, 20), (620, 460), (20, 460)])
    apart = measure_agreement(views, aside(0, 0, 0, 0)).pairs[0, 1]
    linked = measure_agreement(views, aside(0, 0, 0, 0), [Link(0, 1, corners, corners, 4, 4)]).pairs
    assert apart.different >= MIN_RECOGNISED
    assert replace(apart, different=0) == linked[0, 1]
    assert linked[0, 3] == measure_agreement(views, aside(0, 0, 0, 0)).pairs[0, 3]
    left = [Link(0, 1, corners * (0.2, 1), corners * (0.2, 1), 4, 4)]
    assert measure_agreement(views, aside(0, 0, 0, 0), left).pairs[0, 1] == apart


def test_photographs_of_one_place_are_compared_with_some_of_the_others() -> None:
    many = 2 * MAX_COMPARED
    found = measure_agreement(seen(*[noise(0)[:, :320]] * many), aside(*[0] * many))
    compared = [sum(left == view for left, _ in found.pairs) for view in range(many)]
    assert max(compared[: -MAX_COMPARED - 1]) == MAX_COMPARED // 2
    assert max(compared) == MAX_COMPARED
    assert {end for pair in found.pairs for end in pair} == set(range(many))


def test_the_headline_counts_every_pair_that_tells() -> None:
    agrees, differs, unknown = GroundOfPair(2, 9, 3.5, 0), GroundOfPair(1, 9, 1.0, 0), GroundOfPair(3, 3, 9.0, 0)
    pairs = {(0, 1): agrees, (0, 2): agrees, (1, 2): unknown}
    assert Agreement(pairs).description == (
        "2 of 2 pairs that overlap by half agree (100%), nine in ten within 4 px; 1 cannot tell"
    )
    mixed = Agreement(pairs | {(0, 3): differs})
    assert mixed.numbers == {"agree": 2, "disagree": 1, "cannot_tell": 1, "ninety_px": None}
    assert mixed.description == "2 of 3 pairs that overlap by half agree (67%); 1 cannot tell"


def joint(across: dict[tuple[int, int], GroundOfPair], within: int = 0) -> tuple[list[int], str] | None:
    """What is found of a joint of two photographs with two more, of which ``within`` of 50 patches are different."""
    nothing = np.zeros((0, 2))
    grounds = {(0, 1): GroundOfPair(50, 50, 1.0, within), (2, 3): GroundOfPair(50, 50, 1.0, 0)} | across
    links = [Link(*pair, nothing, nothing, 50, 50) for pair in ((0, 1), (1, 2), (2, 3))]
    tried = {(1, 2): Link(1, 2, np.zeros((9, 2)), np.zeros((9, 2)), 9, 9), (0, 2): Link(0, 2, nothing, nothing, 4, 0)}
    return find_false_joint(Agreement(grounds), range(4), links, tried)


@pytest.mark.parametrize(
    ("different", "within", "apart"), [(9, 0, True), (8, 0, False), (25, 4, True), (24, 4, False), (24, 3, True)]
)
def test_a_joint_is_false_by_what_is_different_across_it_and_not_within(
    different: int, within: int, apart: bool
) -> None:
    # No pair disagrees; of 100 patches across, some are not there.
    quarter = different // 4
    across = dict.fromkeys([(0, 2), (0, 3), (1, 2)], GroundOfPair(15, 25, 1.0, quarter))
    across[1, 3] = GroundOfPair(15, 25, 1.0, different - 3 * quarter)
    assert across[1, 3].agrees
    found = joint(across, within)
    assert (found is not None) is apart
    if found is not None:
        assert found[0] in ([0, 1], [2, 3])


def test_a_false_joint_is_described_by_all_pairs_across_it() -> None:
    across = {(0, 2): GroundOfPair(0, 10, np.inf, 6), (1, 2): GroundOfPair(5, 10, 1.0, 0)}
    found = joint(across | {(0, 3): GroundOfPair(9, 20, 1.0, 4)})
    assert found is not None
    assert found[1] == (
        "the ground contradicts: across them 25% of what photographs recognise is not there, in 2 of 3 pairs that "
        "overlap by half, and 1 of 2 tried do not hold"
    )
    # So few patches may be different by chance.
    assert joint({(0, 2): GroundOfPair(0, 10, np.inf, 3)}) is None


def test_of_joints_that_explain_what_is_different_the_least_sure_is_false() -> None:
    # What 1 and 2 share is the twin; all that is different lies in 0.
    twin, differs = GroundOfPair(36, 40, 1.0, 0), GroundOfPair(10, 30, 1.0, 15)
    found = joint({(1, 2): twin, (0, 2): differs, (0, 3): differs})
    assert found is not None
    assert found[0] in ([0, 1], [2, 3])
