"""What is written of a track: rows, tables and outlines."""

import json
from fractions import Fraction
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from skymosaic.common.errors import OutputError, RegistrationError
from skymosaic.imagery.video import VideoReader
from skymosaic.tracking.output import draw_outline, follow_video, make_row, save_corners
from skymosaic.tracking.tracker import TrackedFrame

BLACK = np.zeros((60, 80, 3), np.uint8)
CORNERS = np.array([[10.0004, 20.0], [50.25, 20.0], [50.25, 40.9996], [10.0, 41.0]])
POSE: Any = SimpleNamespace(model="similarity", inliers=9)
SEEN = TrackedFrame(0, BLACK, CORNERS, POSE)
LOST = TrackedFrame(1, BLACK, None, None, "lost: hidden")


def test_a_row_has_corners_or_the_reason_and_files_have_both(tmp_path: Path) -> None:
    rows = [make_row(SEEN, 0.12345678), make_row(LOST, 0.2)]
    assert rows[0].corners == ((10.0, 20.0), (50.25, 20.0), (50.25, 41.0), (10.0, 41.0))
    save_corners(tmp_path / "a.csv", rows)
    assert (tmp_path / "a.csv").read_text() == (
        "frame,seconds,x0,y0,x1,y1,x2,y2,x3,y3,model,inliers,reason\n"
        "0,0.123457,10.0,20.0,50.25,20.0,50.25,41.0,10.0,41.0,similarity,9,\n"
        "1,0.2,,,,,,,,,,0,lost: hidden\n"
    )
    save_corners(tmp_path / "a.JSON", rows)
    seen, lost = json.loads((tmp_path / "a.JSON").read_text())["corners"]
    assert (seen["corners"][2], seen["model"], seen["inliers"]) == ([50.25, 41.0], "similarity", 9)
    assert (lost["corners"], lost["inliers"], lost["reason"]) == (None, 0, "lost: hidden")


def test_the_outline_is_closed_and_green_on_a_copy_of_the_frame() -> None:
    drawn = draw_outline(SEEN)
    for x, y in ((30, 20), (50, 30), (30, 41), (10, 30)):
        assert drawn[y, x, 1] > 200
        assert drawn[y, x, [0, 2]].tolist() == [0, 0]
    assert not drawn[24:37, 14:47].any()
    assert not draw_outline(LOST).any()
    assert not BLACK.any()


@pytest.mark.parametrize(("found", "is_writable"), [((0,), True), ((0, 2), False), ((), False)])
def test_a_video_that_cannot_be_written_costs_no_table(
    tmp_path: Path, found: tuple[int, ...], is_writable: bool
) -> None:
    class Reader:
        name, frame_rate, seconds = "film.mp4", Fraction(10), 0.0

        def __iter__(self) -> Any:
            for number in range(3):
                self.seconds = number / 10
                yield TrackedFrame(number, BLACK, *((CORNERS, POSE) if number in found else (None, None)))

    tracker: Any = SimpleNamespace(follow=lambda frame: frame)
    output = tmp_path / ("out.mp4" if is_writable else "no_folder/out.mp4")
    told: list[int] = []
    failures: list[str] = []

    def follow(failures: list[str] | None) -> Any:
        told.clear()
        return follow_video(tracker, Reader(), output, lambda frame, _: told.append(frame.number), failures)  # type: ignore[arg-type]

    if not found:
        with pytest.raises(RegistrationError, match=r"film.mp4: the template was found in none of 3 frames"):
            follow(failures)
        return
    rows = follow(failures)
    assert [(row.frame, row.seconds, row.corners is not None) for row in rows] == [
        (number, number / 10, number in found) for number in range(3)
    ]
    assert told == [0, 1, 2]
    assert output.exists() is is_writable
    assert len(failures) == (not is_writable)
    if is_writable:
        # The outline is drawn in the frame in which the object was found.
        assert [frame[..., 1].max() > 100 for frame in VideoReader(output)] == [True, False, False]
    if not is_writable:
        with pytest.raises(OutputError):
            follow(None)
