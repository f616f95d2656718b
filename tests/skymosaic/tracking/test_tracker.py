"""Tracking a rendered car whose corners are known, through a bridge, by the golden model and by hardware."""

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from golden_model.arrays import Pixels
from sim.backends.interface import Backend, Reference
from sim.scene.target import Pursuit
from sim.simulators.scoreboard import find_mismatch
from skymosaic.common.errors import InputError, RegistrationError
from skymosaic.features.backends import load_backend
from skymosaic.tracking.template import Roi
from skymosaic.tracking.tracker import TrackedFrame, Tracker
from tests.skymosaic.tracking.conftest import true_corners

HIDDEN = 0.05
"""A car of which the bridge leaves no more than this share is not to be found."""


def test_a_car_is_tracked_and_found_again_after_a_bridge_hides_it(
    film: Pursuit, film_frames: list[Pixels], roi: Roi
) -> None:
    truth = true_corners(film, roi)
    tracked = list(map(Tracker(roi).follow, film_frames))
    found = np.array([each.corners is not None for each in tracked])
    errors = [
        np.linalg.norm(each.corners - truth[each.number], axis=1).mean() for each in tracked if found[each.number]
    ]
    assert np.mean(errors) < 0.5
    assert np.max(errors) < 2.0
    hidden = np.flatnonzero(film.visible <= HIDDEN)
    assert len(hidden) >= 8
    assert not found[hidden].any()
    # Before the bridge it is never lost; behind it, it is found as soon as all of it is seen again.
    assert found[: np.flatnonzero(film.visible < 1)[0]].all()
    assert found[hidden[-1] :][film.visible[hidden[-1] :] >= 1].all()
    assert (film.visible[hidden[-1] :] >= 1).any()


def test_a_template_of_larger_scale_is_found(
    film: Pursuit, film_frames: list[Pixels], roi: Roi, tmp_path: Path
) -> None:
    cut = film_frames[0][roi.y_px : roi.y_px + roi.height_px, roi.x_px : roi.x_px + roi.width_px]
    cv2.imwrite(str(tmp_path / "car.png"), cv2.resize(cut, None, fx=2, fy=2, interpolation=cv2.INTER_CUBIC))
    truth = true_corners(film, roi)[1:]
    tracked = list(map(Tracker(tmp_path / "car.png").follow, film_frames[1:10]))
    errors = [np.linalg.norm(each.corners - truth[each.number], axis=1).mean() for each in tracked if each.pose]
    assert len(errors) >= 6
    # Half of one of its own pixels is 0.25 px here.
    assert np.mean(errors) < 0.3


@pytest.mark.parametrize(
    ("roi", "says"),
    [
        (Roi(0, 0, 16, 16), ""),
        (Roi(0, 0, 15, 16), "roi 0,0,15,16: too small; give at least 16x16 pixels"),
        (Roi(0, 0, 16, 15), "roi 0,0,16,15: too small"),
        (Roi(64, 0, 16, 70), ""),
        (Roi(0, 54, 80, 16), ""),
        (Roi(65, 0, 16, 70), "roi 65,0,16,70: not inside the first frame, 80x70 pixels; give x,y,width,height"),
        (Roi(0, 55, 80, 16), "not inside"),
        (Roi(-1, 0, 16, 16), "not inside"),
        (Roi(0, -1, 16, 16), "not inside"),
    ],
)
def test_a_rectangle_lies_inside_the_first_frame(roi: Roi, says: str) -> None:
    # Of a rectangle that can be followed, the flat picture is refused.
    with pytest.raises((InputError, RegistrationError), match=says or "the template has 0 features, 12 needed"):
        Tracker(roi).follow(np.full((70, 80, 3), 120, np.uint8))


class Recorded(Backend):
    """A front end that keeps what it was asked and what it answered."""

    def __init__(self, backend: str) -> None:
        self._front_end = load_backend(backend)
        self.runs: list[tuple] = []

    def run(self, film_frames: Any, config: Any, *, reference: Reference = "held") -> Any:
        results = self._front_end.run(film_frames, config, reference=reference)
        self.runs.append((film_frames, reference, results))
        return results


@pytest.mark.slow
def test_hardware_with_a_held_reference_tracks_the_same_corners(film_frames: Any, roi: Any) -> None:
    """Compiles the accelerator the first time."""
    tracked, recorded = {}, {}
    for backend in ("golden", "rtl"):
        recorded[backend] = Recorded(backend)
        tracked[backend] = list(map(Tracker(roi, backend=recorded[backend]).follow, film_frames[:6]))
    assert {reference for _, reference, _ in recorded["rtl"].runs} == {"held"}
    assert sum(len(results[-1].matches) for *_, results in recorded["rtl"].runs) > 100
    for (*_, wanted), (*_, got) in zip(recorded["golden"].runs, recorded["rtl"].runs, strict=True):
        assert find_mismatch(wanted, got) is None
    for wanted, got in zip(tracked["golden"], tracked["rtl"], strict=True):
        np.testing.assert_array_equal(wanted.corners, got.corners)


def test_what_a_callback_raises_does_not_end_the_track(roi: Roi, film_frames: list[Pixels]) -> None:
    def break_at_the_second(tracked: TrackedFrame) -> None:
        assert tracked.number != 1, "broken"

    with Tracker(roi, on_frame=break_at_the_second) as tracker:
        assert not tracker.follow(film_frames[0]).reason
        with pytest.raises(AssertionError, match="broken"):
            tracker.follow(film_frames[1])
        assert tracker.follow(film_frames[2]).corners is not None
    with pytest.raises(InputError, match="ended"):
        tracker.follow(film_frames[3])
