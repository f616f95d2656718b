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
    at_night,
    ground,
    seen,
    with_dirt,
    with_display,
    with_jittering_display,
    with_lines,
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


def test_the_farther_a_camera_moves_the_less_must_agree(sites: list[Pixels]) -> None:
    sight = Sight(sites[0])
    moved = [measure_ground(sight, sight, np.array([[1.0, 0, x], [0, 1, 0], [0, 0, 1]])) for x in (0, 64, 160)]
    assert [each.required for each in moved] == pytest.approx([0.7, 0.4, -0.05])
    assert [each.suffices for each in moved] == [True, False, True]
    assert measure_ground(sight, Sight(~sites[0]), np.eye(3)).share == 0


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
