"""The task that follows an object through a video, run in a worker."""

import shlex
import time
from pathlib import Path

from skymosaic.errors import RegistrationError
from skymosaic.imagery.images import save_bytes
from skymosaic.imagery.video import VideoReader, write_video
from skymosaic.panel.options import Options
from skymosaic.panel.results import TrackingResult
from skymosaic.panel.steps import Progress
from skymosaic.tracking.output import TrackedCorners, draw_outline, make_row, save_corners
from skymosaic.tracking.tracker import Tracker

VIDEO, CORNERS = "tracked.mp4", "corners.csv"


def follow(
    folder: Path, template: str, video: str, options: Options, pictures: Path, *, progress: Progress
) -> TrackingResult:
    """Follow the template through the video; write the outlined video and the corners of every frame to ``folder``.

    The options ``preset`` and ``backend`` apply.

    Raises
    ------
    RegistrationError
        If the object was found in no frame.
    """
    reader = VideoReader(folder / video)
    rows: list[TrackedCorners] = []
    started = time.perf_counter()
    tracker = Tracker(folder / template, preset=options.preset, backend=options.backend_name)
    with write_video(folder / VIDEO, reader.frame_rate) as write:
        for frame in map(tracker.follow, reader):
            write(draw_outline(frame))
            rows.append(make_row(frame, reader.frame_rate))
            progress(f"frame {frame.number + 1}")
        # Raised in here, so that no video is left behind.
        if not any(each.corners for each in rows):
            raise RegistrationError(f"{video}: the object was found in none of {len(rows)} frames")
    seconds = time.perf_counter() - started
    save_corners(folder / CORNERS, rows)
    words = ["skymosaic", "track", template, video, "-o", VIDEO, "--corners", CORNERS, "--overwrite"]
    command = shlex.join([*words, "--preset", options.preset, "--backend", options.backend_name])
    save_bytes(folder / "command.txt", f"{command}\n".encode())
    (pictures / VIDEO).hardlink_to(folder / VIDEO)
    return TrackingResult(
        folder, pictures, command, pictures / VIDEO, tuple(rows), seconds / len(rows), tuple(reader.notes)
    )
