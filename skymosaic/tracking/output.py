"""Output of tracking: frames with the object's outline, and a table of its corners."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from golden_model.arrays import Pixels
from skymosaic.common.errors import OutputError, RegistrationError
from skymosaic.common.provenance import to_json
from skymosaic.common.tables import to_csv
from skymosaic.imagery.images import save_bytes
from skymosaic.imagery.video import VideoReader, write_video
from skymosaic.tracking.tracker import TrackedFrame, Tracker

TABLE_SUFFIXES = (".csv", ".json")
OUTLINE_COLOR = (0, 255, 0)
OUTLINE_WIDTH_PX = 2
_SUBPIXEL_SHIFT = 4


@dataclass(frozen=True)
class TrackedCorners:
    """One row of the table: corners (x, y) clockwise from the template's top left, or the reason why there are none."""

    frame: int
    seconds: float
    corners: tuple[tuple[float, float], ...] | None
    model: str
    inliers: int
    reason: str = ""


def draw_outline(frame: TrackedFrame) -> Pixels:
    """Copy the frame and draw the template's outline in green; none if the template was lost."""
    picture = frame.pixels.copy()
    if frame.corners is not None:
        corners = np.rint(frame.corners * (1 << _SUBPIXEL_SHIFT)).astype(np.int32)
        cv2.polylines(picture, [corners], True, OUTLINE_COLOR, OUTLINE_WIDTH_PX, cv2.LINE_AA, _SUBPIXEL_SHIFT)
    return picture


def make_row(frame: TrackedFrame, seconds: float) -> TrackedCorners:
    """Make the table row of a frame; corners are rounded to 0.001 px."""
    seconds = round(seconds, 6)
    if frame.corners is None or frame.pose is None:
        return TrackedCorners(frame.number, seconds, None, "", 0, frame.reason)
    corners = tuple((round(float(x), 3), round(float(y), 3)) for x, y in frame.corners)
    return TrackedCorners(frame.number, seconds, corners, frame.pose.model, frame.pose.inliers)


def follow_video(
    tracker: Tracker,
    reader: VideoReader,
    output: Path,
    on_frame: Callable[[TrackedFrame, TrackedCorners], None],
    failures: list[str] | None = None,
) -> list[TrackedCorners]:
    """Follow the object through a video, write the video with its outline, and return the rows of the table.

    With ``failures``, a video that cannot be written is a line there, and the table is made all the same.

    Raises
    ------
    OutputError
    RegistrationError
        If the object was found in no frame.
    """
    rows: list[TrackedCorners] = []

    def follow() -> Iterator[TrackedFrame]:
        for frame in map(tracker.follow, reader):
            rows.append(make_row(frame, reader.seconds))
            on_frame(frame, rows[-1])
            yield frame
        if not any(each.corners for each in rows):
            raise RegistrationError(
                f"{reader.name}: the template was found in none of {len(rows)} frames; one that is cut from this video "
                "is found best, for example with --roi"
            )

    frames = follow()
    try:
        with write_video(output, reader.frame_rate, lambda: reader.seconds) as write:
            for frame in frames:
                write(draw_outline(frame))
    except OutputError as error:
        if failures is None:
            raise
        failures.append(str(error))
        for _ in frames:
            pass
    return rows


def save_corners(path: Path, rows: Sequence[TrackedCorners]) -> None:
    """Write the rows as CSV or JSON, according to the suffix."""
    if path.suffix.lower() == ".json":
        save_bytes(path, to_json({"corners": list(map(vars, rows))}))
        return
    names = [f"{axis}{corner}" for corner in range(4) for axis in "xy"]
    table = []
    for each in rows:
        values = [""] * 8 if each.corners is None else [value for point in each.corners for value in point]
        table.append([each.frame, each.seconds, *values, each.model, each.inliers, each.reason])
    save_bytes(path, to_csv(["frame", "seconds", *names, "model", "inliers", "reason"], table).encode())
