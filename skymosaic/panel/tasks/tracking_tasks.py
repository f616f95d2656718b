"""The task that follows an object through a video, run in a worker."""

import shlex
from pathlib import Path

from skymosaic.common.options import command_words
from skymosaic.common.stopwatch import Stopwatch
from skymosaic.imagery.images import save_bytes
from skymosaic.imagery.video import VideoReader
from skymosaic.panel.options import Options
from skymosaic.panel.results import TrackingResult
from skymosaic.panel.tasks.jobs import Progress
from skymosaic.tracking.output import follow_video, save_corners
from skymosaic.tracking.tracker import Tracker, TrackerOptions

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
    chosen = TrackerOptions(preset=options.preset, backend=options.backend, address=options.address)
    clock = Stopwatch()
    tracker = Tracker(folder / template, chosen)
    rows = follow_video(tracker, reader, folder / VIDEO, lambda frame, _row: progress(f"frame {frame.number + 1}"))
    seconds = clock.lap("tracking")
    save_corners(folder / CORNERS, rows)
    words = ["skymosaic", "track", template, video, "-o", VIDEO, "--corners", CORNERS, "--overwrite"]
    command = shlex.join([*words, *command_words(chosen)])
    save_bytes(folder / "command.txt", f"{command}\n".encode())
    (pictures / VIDEO).hardlink_to(folder / VIDEO)
    return TrackingResult(
        folder, pictures, command, pictures / VIDEO, tuple(rows), seconds / len(rows), tuple(reader.notes)
    )
