"""What a registration asks of the front end."""

from collections.abc import Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from golden_model.config import Config
from golden_model.records import MATCH
from sim.backends.golden import GoldenBackend
from sim.backends.interface import FrameResult
from sim.scene import make_pair
from skymosaic.imagery.images import Photograph
from skymosaic.imagery.lens import Lens
from skymosaic.registration.options import RegistrationOptions
from skymosaic.registration.register import _look_behind_display, register, register_photographs

MODULE = "skymosaic.registration.register"
PIXELS = np.zeros((96, 128, 3), np.uint8)
MASK = np.full((96, 128), 255, np.uint8)
MASK[:30] = 0


class AskedError(Exception):
    """The configuration that a front end was asked to run with."""


class Asking(GoldenBackend):
    def run(self, frames: Sequence[NDArray[np.uint8]], config: Config, **options: Any) -> list[FrameResult]:
        raise AskedError(config)


@pytest.mark.parametrize("masked", ["nothing", "by the lens", "by the photograph"])
def test_what_the_hardware_would_estimate_counts_where_nothing_is_masked(masked: str) -> None:
    """It does not know the mask, which may be that of one photograph alone."""
    lens = Lens(mask=MASK) if masked == "by the lens" else None
    seen = MASK if masked == "by the photograph" else None
    photographs = Photograph("left", PIXELS), Photograph("right", PIXELS, visible=seen)
    options = RegistrationOptions(estimator="fabric", backend=Asking())
    with pytest.raises(AskedError) as asked:
        register_photographs(photographs, options, seconds={}, lens=lens)
    assert (asked.value.args[0].estimator is not None) == (masked == "nothing")


@pytest.mark.parametrize(("height_px", "shares", "asked"), [(127, True, False), (128, False, False), (128, True, True)])
def test_only_a_pair_in_doubt_is_registered_without_a_pattern(
    monkeypatch: pytest.MonkeyPatch, height_px: int, shares: bool, asked: bool
) -> None:
    """At half of the size, which must be enough for the front end."""
    again = object()
    monkeypatch.setattr(f"{MODULE}.share_pattern", lambda *_: shares)
    monkeypatch.setattr(f"{MODULE}._register_without_pattern", lambda *_: again)
    flat = np.full((height_px, 160, 3), 90, np.uint8)
    assert (register(flat, flat) is again) == asked
    left, right = make_pair(seed=5, size=(320, 240)).images
    assert register(left, right, effort="fast").accepted


@pytest.mark.parametrize(
    ("still", "off_px", "moved_px", "masked"),
    [(4, 1.0, 17, True), (3, 1.0, 17, False), (4, 1.125, 17, False), (4, 0.0, 16, False)],
)
def test_what_stands_still_before_moving_ground_is_looked_behind(
    monkeypatch: pytest.MonkeyPatch, still: int, off_px: float, moved_px: int, masked: bool
) -> None:
    """Of 320 px, a twentieth are 16; a match that is not kept shows no display."""
    left, right = make_pair(seed=5, size=(320, 240)).images
    pair = register(left, right, effort="fast")
    pair = pair.with_homography(np.array([[1.0, 0, moved_px], [0, 1, 0], [0, 0, 1]]), 0)
    matches = np.zeros(9, MATCH.dtype)
    matches["left_x"] = 16 * np.arange(9) + 160
    matches["right_x"] = matches["left_x"] - np.uint16(16 * off_px)
    matches["verdict"][:still] = 1
    ground: Any = SimpleNamespace(wins=True)
    moving = np.zeros((240, 320), np.bool_)
    moving[:9] = True
    monkeypatch.setattr(f"{MODULE}.find_shared", lambda *_: moving)
    monkeypatch.setattr(f"{MODULE}.measure_agreement", lambda *_: ground)
    behind = _look_behind_display(pair, matches)
    assert (behind is not pair) == masked
    if masked:
        assert behind.ground is ground
        assert [np.array_equal(mask == 0, moving) for mask in behind.visible if mask is not None] == [True, True]
    assert _look_behind_display(pair.refused(""), matches).homography is None
    ground.wins = False
    assert _look_behind_display(pair, matches) is pair


@pytest.mark.parametrize(
    ("rows", "side", "accept_poor", "refused"),
    [(110, "both", False, True), (110, "both", True, False), (110, "left", False, False), (130, "both", False, False)],
)
def test_a_homography_of_a_display_is_refused(
    monkeypatch: pytest.MonkeyPatch, rows: int, side: str, accept_poor: bool, refused: bool
) -> None:
    """One match that stands still is enough for a look; a pattern over most of the picture is no display."""
    left, right = make_pair(seed=5, size=(320, 240)).images
    pair = register(left, right, effort="fast")
    inliers = pair.inliers.copy()
    for end in ("left", "right"):
        inliers[f"{end}_y"] = 16 * np.where(np.arange(len(inliers)) % 5, 50 if side in (end, "both") else 200, 200)
    pair = replace(pair.with_homography(np.array([[1.0, 0, 90], [0, 1, 0], [0, 0, 1]]), 0), inliers=inliers)
    match = np.zeros(1, MATCH.dtype)
    match["verdict"] = 1
    moving = np.zeros((240, 320), np.bool_)
    moving[:rows] = True
    monkeypatch.setattr(f"{MODULE}.find_shared", lambda *_: moving)
    judged = _look_behind_display(pair, match, accept_poor=accept_poor)
    assert judged.accepted != refused
    assert not refused or judged.reason.startswith("69 inliers lie on what both show at the same pixels; ")
