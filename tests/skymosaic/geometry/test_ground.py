"""What moves with the camera, an on-screen display or dirt on the lens, is not taken for the ground."""

import re
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import cv2
import numpy as np
import pytest

from golden_model.arrays import Pixels
from skymosaic import register
from skymosaic.geometry import ground as module
from skymosaic.geometry.ground import (
    GroundAgreement,
    LeftOut,
    Sight,
    find_ground,
    lay_over,
    measure_ground,
    measure_rival,
)
from skymosaic.geometry.homography import apply
from tests.skymosaic.geometry.covered import (
    SIZE,
    at_night,
    ground,
    seen,
    with_dirt,
    with_display,
    with_jittering_display,
    with_lines,
    with_watermarks,
)


@pytest.fixture(scope="module")
def sites() -> list[np.ndarray]:
    """Photographs of three places that have nothing in common."""
    return [seen(ground(seed), 300, 200) for seed in (5, 6, 7)]


@pytest.mark.parametrize("cover", [with_dirt, with_jittering_display])
def test_what_stands_still_joins_no_different_places(sites: list[Pixels], cover: Callable[..., Any]) -> None:
    pair = register(cover(sites[0]), cover(sites[1]))
    assert not pair.accepted
    assert re.search("% of the (ground|overlap)", pair.reason)


@pytest.mark.parametrize("cover", [with_display, with_dirt])
def test_the_ground_behind_it_is_registered(cover: Callable[..., Any]) -> None:
    place = ground(5)
    left, right = seen(place, 200, 150), seen(place, 330, 190, degrees=4)
    plain, covered = register(left, right), register(cover(left), cover(right))
    assert covered.accepted
    corners = np.array([(0, 0, 1), (640, 0, 1), (640, 480, 1), (0, 480, 1)], dtype=float).T
    one, other = ((h @ corners)[:2] / (h @ corners)[2] for h in (plain.homography, covered.homography))
    assert np.abs(one - other).max() < 3


def test_a_sensors_pattern_is_subtracted_from_a_pair() -> None:
    place = ground(5)
    left, right = seen(place, 200, 150), seen(place, 330, 190, degrees=4)
    plain, dark = register(left, right), register(at_night(left, 0), at_night(right, 1))
    assert plain.homography is not None
    assert dark.homography is not None
    grid = np.stack(np.meshgrid((200, 400, 600), (100, 300, 450)), axis=-1).reshape(-1, 2).astype(float)
    assert apply(dark.homography, grid) == pytest.approx(apply(plain.homography, grid), abs=1)
    # The matches are in the photographs' pixels, as the homography is; an inlier is 2 px of the half size off, at most.
    points = dark.points()
    assert np.percentile(np.linalg.norm(apply(plain.homography, points.left) - points.right, axis=1), 90) < 4
    assert dark.confidence is not None
    assert dark.confidence.evidence.ground_share > 0.6
    assert "moves with the camera" in dark.right.notes[-1]


@pytest.mark.parametrize("contrast", [0.12, 0.02])
def test_a_sensors_pattern_joins_no_different_places(sites: list[Pixels], contrast: float) -> None:
    pair = register(at_night(sites[0], 0, contrast), at_night(sites[1], 1, contrast), effort="fast")
    assert not pair.accepted
    assert "of the ground" in pair.reason


def test_copies_of_one_photograph_are_told(sites: list[Pixels]) -> None:
    pair = register(sites[0], sites[0].copy())
    assert pair.accepted
    assert pair.right.notes == ("the same picture as left image",)


def test_a_camera_that_hovers_sees_the_ground() -> None:
    rng, place = np.random.default_rng(1), ground(5)
    left, right = (
        np.clip(seen(place, x, y) + rng.normal(0, 4, (480, 640, 3)), 0, 255).astype(np.uint8)
        for x, y in ((300, 200), (301, 201))
    )
    pair = register(left, right)
    assert pair.confidence is not None
    assert pair.confidence.verdict == "good"
    assert not pair.right.notes


def test_where_nothing_has_moved_a_watermark_may_be_what_agrees(sites: list[Pixels]) -> None:
    hazy = (np.asarray(80 + 0.3 * site.astype(np.float64), np.uint8) for site in sites[:2])
    left, right = (with_watermarks(image) for image in hazy)
    refused, pair = (register(left, right, accept_poor=accept_poor) for accept_poor in (False, True))
    assert not refused.accepted
    assert "repeats itself" in refused.reason
    assert pair.confidence is not None
    assert pair.confidence.evidence.ground_lack == 0
    assert pair.confidence.verdict == "poor"


@pytest.mark.parametrize("gravel", [0, 3, 20])
def test_a_display_over_nothing_or_over_gravel_is_refused(gravel: int) -> None:
    rng, displays = np.random.default_rng(1), []
    for _ in range(2):
        shown = cv2.resize(rng.normal(90, gravel, (120, 160)).clip(0, 255), (640, 480)).astype(np.uint8)
        for line in range(8):
            text = f"ALT 1{line}7 M SPD {line}.4 GPS 12 BAT 14.{line}V"
            cv2.putText(shown, text, (5, 25 + 60 * line), cv2.FONT_HERSHEY_SIMPLEX, 0.8, (255, 255, 255), 2)
        displays.append(shown)
    assert not register(*displays).accepted
    pair = register(*displays, accept_poor=True)
    assert pair.confidence is not None
    assert pair.confidence.verdict == "poor"
    assert re.match(r"[1-6]\d % of the ground more should agree|the ground repeats itself", pair.confidence.reason)


def test_water_below_a_camera_that_hovers_is_refused_with_the_shares_and_delivered_on_request(
    sites: list[Pixels],
) -> None:
    bank, later = sites[0], sites[0].copy()
    later[:, 250:] = sites[1][:, 250:]
    refused, delivered = (
        register(bank, later, effort="fast", accept_poor=accept_poor) for accept_poor in (False, True)
    )
    assert not refused.accepted
    assert re.match(r"the camera moved by only 0|\d\d % of the ground more should agree for a camera", refused.reason)
    assert "`accept_poor`" in refused.reason
    assert delivered.homography == pytest.approx(np.eye(3), abs=0.01)
    assert delivered.confidence is not None
    assert delivered.confidence.verdict == "poor"
    assert delivered.confidence.reason in refused.reason


def test_a_shore_below_a_camera_that_hovers_is_delivered(sites: list[Pixels]) -> None:
    later = seen(ground(5), 304, 203)
    later[:, 390:] = sites[1][:, 390:]
    pair = register(sites[0], later)
    assert pair.homography == pytest.approx(np.array([[1, 0, -4], [0, 1, -3], [0, 0, 1]]), abs=0.1)
    assert pair.evidence is not None
    assert 0 < pair.evidence.ground_lack < 0.2


def test_what_a_mask_or_a_display_hides_does_not_vote(sites: list[Pixels]) -> None:
    moved = sites[0].copy()
    moved[:, 250:] = sites[1][:, 250:]
    visible = np.zeros(moved.shape[:2], np.uint8)
    visible[:, :250] = 255
    whole = measure_ground(Sight(sites[0]), Sight(moved), np.eye(3))
    masked = measure_ground(Sight(sites[0], visible), Sight(moved), np.eye(3))
    assert whole.share < 0.5
    assert masked.share == 1
    assert 0.3 * whole.blocks < masked.blocks < 0.45 * whole.blocks
    agreement = measure_ground(Sight(with_lines(sites[0])), Sight(with_lines(sites[1])), np.eye(3))
    coarse = np.count_nonzero(agreement.agreeing) / agreement.blocks
    assert agreement.required - 0.2 < coarse < agreement.required
    assert agreement.share < 0.53
    assert not agreement.suffices


def test_between_the_lines_of_a_display_the_ground_of_a_moved_camera_is_good() -> None:
    place = ground(5)
    pair = register(with_lines(seen(place, 200, 150)), with_lines(seen(place, 260, 80)))
    assert pair.confidence is not None
    assert pair.confidence.verdict == "good"
    assert pair.confidence.evidence.ground_share > 0.9


def test_the_farther_a_camera_moves_the_less_must_agree(sites: list[Pixels]) -> None:
    sight = Sight(sites[0])
    moved = [measure_ground(sight, sight, np.array([[1.0, 0, x], [0, 1, 0], [0, 0, 1]])) for x in (0, 64, 160)]
    assert [each.required for each in moved] == pytest.approx([0.7, 0.4, -0.05])
    assert [each.suffices for each in moved] == [True, False, True]
    assert measure_ground(sight, Sight(~sites[0]), np.eye(3)).share == 0


def test_faint_ground_votes_in_the_coarsest_pictures_alone() -> None:
    """A third of the picture has strong texture, which stands still; the rest has faint one, of two places."""
    rng = np.random.default_rng(7)
    grain = [cv2.resize(rng.normal(size=(60, 80)), SIZE, interpolation=cv2.INTER_CUBIC) for _ in range(3)]
    strong = np.arange(SIZE[0]) < SIZE[0] // 3
    left, right = (
        Sight(np.rint(128 + np.where(strong, 15 * grain[0], 1.5 * each)).astype(np.uint8)) for each in grain[1:]
    )
    agreement = measure_ground(left, right, np.eye(3))
    rows, columns = agreement.agreeing.shape
    assert agreement.blocks == pytest.approx(rows * columns / 3, abs=rows)
    assert agreement.share < 0.7 < agreement.agreeing.sum() / agreement.blocks


def test_a_homography_that_moves_all_but_its_matches_joins_no_ground(sites: list[Pixels]) -> None:
    text = np.stack([np.linspace(30, 600, 12), np.linspace(440, 446, 12)], axis=1)
    # A line of text stands still, and one match above it has moved.
    left, right = np.vstack([text, [(320, 60)]]), np.vstack([text, [(320, 200)]])
    homography = np.asarray(cv2.findHomography(left, right)[0])
    corner = apply(homography, np.array([0.0, 0.0]))
    assert np.linalg.norm(corner) > 0.2 * SIZE[0]
    _, agreement, left_out = find_ground(
        lambda left_out: ("fit", None if left_out.rejected else homography, (left, right)),
        lambda _fit: (Sight(sites[0]), Sight(sites[1])),
    )
    assert agreement is not None
    assert not agreement.suffices
    assert len(left_out.rejected) == 1


def agreeing(share: float, blocks: int = 100, motion: float = 0.1, **decided: Any) -> Any:
    """So much of the ground agrees, in pictures of one size, or as another size has ``decided``."""
    voted = {"voted": share if blocks >= 12 else None, **decided}
    return GroundAgreement(np.arange(blocks)[None] < round(share * blocks), blocks, motion, covered=1.0, **voted)


@pytest.mark.parametrize(
    ("agreement", "judged"),
    [
        (agreeing(0.4), "suffices wins"),
        (agreeing(0.39), "wins"),
        (agreeing(0.25, motion=0.2), "suffices wins"),
        (agreeing(0.24, motion=0.2), "suffices"),
        (agreeing(0.0, 11, motion=0.01), "suffices"),
        (agreeing(1.0, 11, motion=0.009), ""),
        (agreeing(0.9, voted=0.3), "wins"),
        (agreeing(0.0, 11, voted=0.5), "suffices"),
    ],
)
def test_how_much_must_agree(agreement: GroundAgreement, judged: str) -> None:
    words = {"suffices": agreement.suffices, "wins": agreement.wins}
    assert [word for word, holds in words.items() if holds] == judged.split()


@pytest.mark.parametrize("written", [0, 40])
def test_a_form_fits_elsewhere_unless_it_is_filled_in(written: int) -> None:
    rng, form = np.random.default_rng(3), np.full((1000, 1500), 250, np.uint8)
    form[60::40, 40:-40] = form[60:, 40::145] = 60
    for _ in range(written):
        cv2.putText(form, str(rng.integers(10**6)), rng.integers(60, 1400, 2).tolist(), 0, 1.2, 40, 3)
    left, right = form[:, :800], form[:, 290:1090]
    shift = np.array([[1.0, 0, -290], [0, 1, 0], [0, 0, 1]])
    assert (measure_rival(lay_over(160, Sight(left), Sight(right), shift)) >= 0.98) == (not written)


def test_what_fits_as_well_elsewhere_is_refused_and_delivered_as_poor(sites: list[Pixels]) -> None:
    tile = cv2.resize(sites[0], (80, 80))
    left, right = (np.tile(tile, (9, 12, 1))[y : y + 480, x : x + 640] for x, y in ((0, 0), (31, 17)))
    refused, delivered = (register(left, right, accept_poor=accept_poor) for accept_poor in (False, True))
    assert not refused.accepted
    assert delivered.confidence is None or delivered.confidence.verdict == "poor"
    assert measure_rival(lay_over(160, Sight(sites[0]), Sight(sites[0]), np.eye(3))) < 0.9


@pytest.mark.parametrize(
    ("moves", "shares", "found"),
    [
        ([None], [], (0, None, 0)),
        ([0.24, 0.1], [], (0, None, 0)),
        ([0.23], [0.02], (0, 0.02, 0)),
        ([0.1], [0.5], (0, 0.5, 0)),
        ([0.1, None], [0.1], (0, 0.1, 1)),
        ([0.1, 0.3], [0.1, 0.3], (1, 0.3, 1)),
        ([0.1, 0.3, None], [0.1, 0.2], (0, 0.1, 2)),
        ([0.1, 0.1, 0.1, None], [0.1, 0.3, 0.5], (2, 0.5, 2)),
        ([0.1, 0.1, 0.1, 0.1, 0.1], [0.1, 0.1, 0.1, 0.1, 0.9], (0, 0.1, 4)),
    ],
)
def test_rivals_are_searched_in_what_is_not_explained(
    monkeypatch: pytest.MonkeyPatch, moves: list[float], shares: list[float], found: tuple[int, float | None, int]
) -> None:
    sight, without = Sight(np.zeros((50, 100), np.uint8)), list[list[int]]()
    points = np.random.default_rng(0).uniform(0, 50, (8, 2))

    def search(left_out: LeftOut) -> Any:
        fit = len(left_out.rejected)
        moved = np.array([100 * (moves[fit] or 0), 0])
        homography = np.array([[1.0, 0, moved[0]], [0, 1, 0], [0, 0, 1]])
        return fit, None if moves[fit] is None else homography, (points, points + moved)

    def measure(*given: Any) -> GroundAgreement:
        """Each time, other blocks agree."""
        number, explained = len(without), given[3]
        without.append([] if explained is None else np.flatnonzero(explained).tolist())
        return replace(agreeing(shares[number], motion=0), agreeing=np.arange(6)[None] == number)

    monkeypatch.setattr(module, "measure_ground", measure)
    fit, agreement, left_out = find_ground(search, lambda _fit: (sight, sight))
    assert (fit, agreement and agreement.share, len(left_out.rejected)) == found
    assert without == [list(range(number)) for number in range(len(shares[:4]))]


def test_what_a_rejected_homography_explains_or_has_beside_it_is_not_apart() -> None:
    shift = np.array([[1.0, 0, 50], [0, 1, 0], [0, 0, 1]])
    left_out = LeftOut(
        (
            (np.eye(3), np.array([[100.0, 100]]), np.array([[100.0, 100]])),
            (shift, np.array([[400.0, 400]]), np.array([[450.0, 400]])),
        )
    )
    cases = {
        (200, 200, 203, 200): False, (200, 200, 204, 200): True, (200, 200, 253, 200): False,
        (200, 200, 254, 200): True, (100, 116, 300, 300): False, (100, 117, 300, 300): True,
        (300, 300, 100, 116): False, (300, 300, 100, 117): True, (384, 400, 300, 300): False,
        (383, 400, 300, 300): True, (300, 300, 434, 400): False, (300, 300, 433, 400): True,
    }  # fmt: skip
    left, right = np.hsplit(np.array(list(cases), np.float64), 2)
    assert left_out.are_apart(left, right).tolist() == list(cases.values())
