"""The predicted error rises, and so confidence falls, as the overlap shrinks and as the ground gets relief."""

import itertools
import re

import cv2
import numpy as np
import pytest

from golden_model.arrays import Pixels
from sim.scene import CameraPose
from skymosaic import register
from skymosaic.features.positions import match_points
from skymosaic.geometry.ground import GroundAgreement, Sight
from skymosaic.geometry.homography import apply
from skymosaic.geometry.uncertainty import FitQuality
from skymosaic.registration.confidence import Confidence, assess, correlate_overlap, fits_throughout
from tests.skymosaic.registration.rendering import CAMERA, view


def view_at(x_px: int, seed: int) -> Pixels:
    """What the camera sees from 384 px above the ground, so that ``x_px`` moves the picture by as many pixels."""
    return view(CameraPose(x_px=x_px, y_px=40, altitude_px=384), seed)


def with_relief(image: Pixels, parallax_px: float) -> Pixels:
    """The image with hills that move what they carry by up to ``parallax_px``, which no homography follows."""
    y, x = np.mgrid[: CAMERA.height_px, : CAMERA.width_px].astype(np.float32)
    moved = x + np.float32(parallax_px) * np.sin(x / 60) * np.cos(y / 45)
    return np.asarray(cv2.remap(image, moved, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT), dtype=np.uint8)


def confidence(left: Pixels, right: Pixels) -> Confidence:
    pair = register(left, right)
    assert pair.confidence is not None, pair.reason
    return pair.confidence


def assert_rising(values: list[float]) -> None:
    assert all(later > earlier for earlier, later in itertools.pairwise(values)), values


@pytest.fixture(scope="module")
def left() -> Pixels:
    return view_at(60, seed=0)


def test_confidence_falls_with_the_overlap(left: Pixels) -> None:
    # Shared by both: 92, 54 and 21 % of the width.
    views = [confidence(left, view_at(x_px, seed=3)) for x_px in (100, 280, 440)]
    assert_rising([each.predicted_px for each in views])
    assert [each.verdict for each in views] == ["good"] * 3
    assert all(each.correlation > 0.7 and each.quality.held_out_share > 0.9 for each in views)
    assert set(views[0].summary()) >= {"verdict", "reason", "predicted_px", "held_out_share", "correlation"}


def test_confidence_falls_with_relief(left: Pixels) -> None:
    right = view_at(100, seed=3)
    hills = [confidence(left, with_relief(right, parallax_px)) for parallax_px in (0, 2, 4, 8, 14)]
    assert_rising([each.predicted_px for each in hills])
    assert_rising([-each.quality.held_out_share for each in hills])
    assert_rising([-each.correlation for each in hills])
    assert [each.verdict for each in hills] == ["good", "good", "good", "check", "poor"]
    assert hills[-1].reason.startswith("relief: ")
    assert hills[-1].quality.held_out_px > 5 > hills[1].quality.held_out_px
    # Photographs of two sizes have no pixels in common that could move with the camera.
    assert confidence(left, with_relief(right, 14)[:-8]).verdict == "poor"


def test_a_poor_pair_on_little_of_the_overlap_is_refused(left: Pixels, monkeypatch: pytest.MonkeyPatch) -> None:
    right = view_at(280, seed=3)
    monkeypatch.setattr("skymosaic.registration.confidence.POOR_PX", 0.0)
    monkeypatch.setattr("skymosaic.registration.confidence.GOOD_PX", 0.0)
    monkeypatch.setattr("skymosaic.registration.confidence.CLEAR_INLIERS", 10_000)
    monkeypatch.setattr("skymosaic.registration.confidence.SURE_CORRELATION", 1.1)
    # Poor, but supported by most of the overlap.
    assert register(left, right).accepted
    monkeypatch.setattr("skymosaic.registration.confidence.SMALL_SHARE_OF_OVERLAP", 1.0)
    assert register(left, right, effort="fast").accepted
    monkeypatch.setattr("skymosaic.registration.confidence.SURELY_FLAT_SHARE", 1.1)
    refused = register(left, right, effort="fast")
    assert not refused.accepted
    assert "`accept_poor`" in refused.reason
    assert "of the overlap" in refused.reason
    delivered = register(left, right, effort="fast", accept_poor=True)
    assert delivered.accepted
    assert delivered.confidence is not None
    assert delivered.confidence.verdict == "poor"
    # What the flow confirms is neither poor nor extrapolated, even where a refit gains nothing.
    monkeypatch.setattr("skymosaic.registration.confidence.FLAT_SHARE", 1.1)
    monkeypatch.setattr("skymosaic.registration.confidence.POOR_PX", 1e-2)
    monkeypatch.setattr("skymosaic.registration.confidence.CONFIRMED_PX", 1e-3)
    confirmed = register(left, right)
    assert confirmed.confidence is not None
    assert (confirmed.confidence.verdict, confirmed.confidence.predicted_px) == ("check", 1e-3)
    assert (confirmed.confirmed, confirmed.refined_inliers) == (True, 0)
    monkeypatch.setattr("skymosaic.registration.dense.ENOUGH_OF_OVERLAP", 1.0)
    assert not register(left, right).accepted
    # Nor is what correlates.
    monkeypatch.setattr("skymosaic.registration.confidence.SURE_CORRELATION", 0.8)
    assert register(left, right).accepted


def test_images_correlate_as_far_as_the_horizon(left: Pixels) -> None:
    size = CAMERA.width_px, CAMERA.height_px
    # Left rows from 162 down show ground of the right image. Formally, so do the first 50, from behind its camera.
    tilted = np.array([[-1.0, 2.4, 0], [0, 2, -100], [0, 0.01, -1]])
    left = left.copy()
    right = np.asarray(cv2.warpPerspective(left, tilted, size, borderMode=cv2.BORDER_REPLICATE), dtype=np.uint8)
    left[:60] = np.random.default_rng(0).integers(0, 256, (60, size[0]))
    assert correlate_overlap(Sight(left), Sight(right), tilted) > 0.85


def ground(share: float = 1.0, motion: float = 0.1) -> GroundAgreement:
    return GroundAgreement(np.arange(100)[None] < round(100 * share), 100, motion, 1.0)


@pytest.mark.parametrize(
    ("verdict", "hull_share", "held_out_share", "extrapolates"),
    [
        ("poor", 0.24, 0.79, True),
        ("poor", 0.25, 0.79, False),
        ("poor", 0.14, 0.8, True),
        ("poor", 0.15, 0.8, False),
        ("check", 0.14, 0.79, False),
    ],
)
def test_flat_ground_needs_less_of_the_overlap(
    verdict: str, hull_share: float, held_out_share: float, extrapolates: bool
) -> None:
    quality = FitQuality(1.0, held_out_share, 3.0, hull_share, 20)
    assert Confidence(verdict, "", 6.0, 0.3, quality, ground()).extrapolates is extrapolates


@pytest.mark.parametrize(
    ("held_out_share", "share", "inliers", "supported"),
    [(0.75, 0.95, 60, True), (0.74, 0.95, 60, False), (0.75, 0.94, 60, False), (0.75, 0.95, 59, False)],
)
def test_well_supported_is_where_many_matches_and_the_ground_agree(
    held_out_share: float, share: float, inliers: int, supported: bool
) -> None:
    quality = FitQuality(0.12345678, held_out_share, 3.0, 0.5, inliers)
    trust = Confidence("check", "so it is", 2.0, 0.3, quality, ground(share, motion=0.3))
    assert trust.is_well_supported is supported
    assert trust.summary() == {
        "verdict": "check", "reason": "so it is", "predicted_px": 2.0, "correlation": 0.3, "instability_px": 0.1235,
        "held_out_share": held_out_share, "held_out_px": 3.0, "hull_share": 0.5, "inliers": inliers,
        "ground_share": share, "ground_required": 0.0, "ground_covered": 1.0,
    }  # fmt: skip


@pytest.mark.parametrize(
    ("quality", "correlation", "agreement", "said"),
    [
        (FitQuality(0.2, 0.9, 1, 0.9, 99), 0.9, ground(), "good, 90 % of held-out matches within 2 px; expected "),
        (FitQuality(0.2, 0.9, 1, 0.9, 99), 0.9, ground(0.39), "check, what agrees covers 39 % of the ground, and "),
        (FitQuality(0.2, 0.9, 1, 0.9, 99), 0.9, ground(0.1), "poor, what agrees covers 10 % of the ground, and "),
        (FitQuality(2, 0.75, 4, 0.9, 20), 0.2, ground(), "check, the overlap correlates by only 0.20; expected "),
        (FitQuality(2, 0.75, 4, 0.5, 20), 0.96, ground(), "check, 75 % of held-out matches within 2 px, and inliers "),
        (
            FitQuality(8, 0.74, 4, 0.25, 20), 0.2, ground(),
            "poor, relief: 74 % of held-out matches within 2 px; expect ghosting of 4 px and more; expected error 12.6",
        ),
        (FitQuality(8, 0.74, 4, 0.9, 19), 0.2, ground(), "poor, only 19 inliers; expected error 5.6 px"),
        (FitQuality(8, 0.74, 4, 0.24, 19), 0.2, ground(0.39), "poor, what agrees covers 39 % of the ground"),
        (FitQuality(0, 0, 12, 0.24, 9), 0, ground(), "check, inliers cover 24 % of the overlap; expected error 2.6 px"),
        (FitQuality(8, 0.74, 4, 0.24, 9), 0.79, ground(), "poor, inliers cover 24 % of the overlap; expected"),
        (
            FitQuality(8, 0.74, 4, 0.24, 9), 0.8, ground(),
            "check, inliers cover 24 % of the overlap; expected error below 4.5 px",
        ),
        (FitQuality(1e9, 0, 12, 0, 9), -1, ground(), "poor, inliers cover 0 % of the overlap; expected error 148.4 px"),
    ],
)  # fmt: skip
def test_the_verdict_has_its_strongest_cause(
    monkeypatch: pytest.MonkeyPatch, quality: FitQuality, correlation: float, agreement: GroundAgreement, said: str
) -> None:
    sight, points = Sight(np.zeros((6, 8), np.uint8)), np.zeros((1, 2))
    monkeypatch.setattr("skymosaic.registration.confidence.assess_fit", lambda *_: quality)
    monkeypatch.setattr("skymosaic.registration.confidence.correlate_overlap", lambda *_: correlation)
    trust = assess((sight, sight), np.eye(3), points, points, ground=agreement)
    assert f"{trust.verdict}, {trust.reason}".startswith(said)
    assert trust.reason.endswith(" px at a width of 8 px")
    confirmed = assess((sight, sight), np.eye(3), points, points, ground=agreement, confirmed=True)
    assert confirmed.predicted_px == min(trust.predicted_px, 4.5)


@pytest.mark.parametrize(
    ("agreeing", "a_row_away", "said"),
    [(100, 20, True), (100, 19, False), (40, 12, True), (40, 11, False), (40, 0, False)],
)
def test_ground_that_repeats_itself_is_never_good(
    monkeypatch: pytest.MonkeyPatch, agreeing: int, a_row_away: int, said: bool
) -> None:
    """As rows of solar panels: wrong matches agree with each other, and farther away in front."""
    rng, row = np.random.default_rng(0), np.array([[1, 0, 0], [0, 1.03, 45], [0, 0, 1]])
    left = rng.uniform(0, 600, (agreeing + a_row_away + 300, 2))
    right = np.concatenate((
        left[:agreeing], apply(row, left[agreeing:-300]), rng.uniform(0, 600, (300, 2))
    ))  # fmt: skip
    sight = Sight(np.zeros((600, 600), np.uint8))
    monkeypatch.setattr("skymosaic.registration.confidence.assess_fit", lambda *_: FitQuality(0.1, 1, 100, 1, 1))
    monkeypatch.setattr("skymosaic.registration.confidence.correlate_overlap", lambda *_: 1)
    trust = assess((sight, sight), np.eye(3), left, right, ground=ground())
    assert trust.verdict == ("check" if said else "good")
    repeats = f"the ground repeats itself: {a_row_away} other matches agree"
    assert trust.reason.startswith(repeats) == said
    assert said == bool(re.search(r"agree \d\d px away; ", trust.reason))


@pytest.mark.parametrize(("width", "height", "alike"), [(38, 38, 1.0), (39, 37, 0.0)])
def test_four_hundred_pixels_away_from_the_edge_correlate(width: int, height: int, alike: float) -> None:
    grain = cv2.GaussianBlur(np.random.default_rng(0).normal(0, 60, (height, width)), (0, 0), 2)
    left, half = (Sight(np.asarray(128 + part * grain, np.uint8)) for part in (1, 0.5))
    assert correlate_overlap(left, half, np.eye(3)) == pytest.approx(alike, abs=0.03)
    assert correlate_overlap(left, Sight(~left.pixels), np.eye(3)) == pytest.approx(-alike, abs=0.001)
    assert correlate_overlap(left, Sight(np.zeros_like(left.pixels)), np.eye(3)) == 0


@pytest.mark.parametrize(
    ("fitting", "near", "width_px", "clear"),
    [(60, 0, 290, True), (60, 0, 288, False), (59, 0, 290, False), (60, 6, 290, True), (60, 7, 290, False)],
)
def test_a_clear_fit_has_so_many_places_on_so_much_of_the_overlap(
    fitting: int, near: int, width_px: int, clear: bool
) -> None:
    x, y = np.meshgrid(np.linspace(0, width_px, 10), np.linspace(0, 359, 7))
    left = np.stack([x.ravel(), y.ravel()], axis=1)[: fitting + near]
    right = left + np.where(np.arange(len(left))[:, None] < fitting, 2, 12) * (1, 0)
    assert fits_throughout(np.eye(3), left, right, (480, 360), (480, 360)) is clear


def test_many_matches_at_few_places_are_not_clear() -> None:
    places = np.random.default_rng(0).uniform((0, 0), (480, 360), (30, 2))
    crowded = np.repeat(places, 5, axis=0)
    assert not fits_throughout(np.eye(3), crowded, crowded, (480, 360), (480, 360))
    spread = np.random.default_rng(1).uniform((0, 0), (480, 360), (150, 2))
    assert fits_throughout(np.eye(3), spread, spread, (480, 360), (480, 360))


def test_a_clear_pair_is_good_without_a_closer_look(left: Pixels, monkeypatch: pytest.MonkeyPatch) -> None:
    pair, hills = (register(left, image) for image in (view_at(100, seed=3), with_relief(view_at(100, seed=3), 8)))
    clear = [
        fits_throughout(each.working_homography, *match_points(each.kept), (480, 360), (480, 360))
        for each in (pair, hills)
        if each.working_homography is not None
    ]
    assert clear == [True, False]
    # How much of the ground agrees was measured by the search.
    monkeypatch.setattr("skymosaic.registration.confidence.measure_agreement", lambda *_: pytest.fail("measured"))
    assert pair.confidence is not None
    assert pair.confidence.ground is pair.ground
    monkeypatch.setattr("skymosaic.registration.pair.assess", lambda *_: pytest.fail("assessed"))
    assert register(left, view_at(100, seed=3)).accepted
