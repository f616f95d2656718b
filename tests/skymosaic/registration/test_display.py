from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from golden_model.records import MATCH
from sim.scene import make_pair
from skymosaic import register
from skymosaic.registration.display import look_behind_display

MODULE = "skymosaic.registration.display"


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
    monkeypatch.setattr(f"{MODULE}.measure_ground", lambda *_: ground)
    behind = look_behind_display(pair, matches)
    assert (behind is not pair) == masked
    if masked:
        assert [np.array_equal(mask == 0, moving) for mask in behind.visible if mask is not None] == [True, True]
    assert look_behind_display(pair.refused(""), matches).homography is None
    ground.wins = False
    assert look_behind_display(pair, matches) is pair


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
    judged = look_behind_display(pair, match, accept_poor=accept_poor)
    assert judged.accepted != refused
    assert not refused or judged.reason.startswith("69 inliers lie on what both show at the same pixels; ")
