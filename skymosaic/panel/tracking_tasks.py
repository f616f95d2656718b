"""What a worker does to follow an object through a video, in the current folder."""

from __future__ import annotations

import shlex
import time
from pathlib import Path

from golden_model.config import preset_config
from sim.backend import Progress
from skymosaic.errors import RegistrationError
from skymosaic.imagery.video import VideoReader, writing
from skymosaic.panel.results import TrackingOutcome
from skymosaic.tracking.output import TrackedCorners, outlined, row, save_corners
from skymosaic.tracking.tracker import track

VIDEO, CORNERS = Path("tracked.mp4"), Path("corners.csv")


def follow(template: str, video: str, preset: str, backend: str, views: Path, *, progress: Progress) -> TrackingOutcome:
    """Follow the template through the video; outline and corners of every frame are written."""
    reader = VideoReader(video)
    rows: list[TrackedCorners] = []
    started = time.perf_counter()
    with writing(VIDEO, reader.frame_rate) as write:
        for frame in track(template, reader, config=preset_config(preset), backend=backend):
            write(outlined(frame))
            rows.append(row(frame, reader.frame_rate))
            progress(f"frame {frame.number + 1}")
        if not any(each.corners for each in rows):
            raise RegistrationError(f"{video}: the object was found in none of {len(rows)} frames")
    seconds = time.perf_counter() - started
    save_corners(CORNERS, rows)
    words = ["skymosaic", "track", template, video, "-o", str(VIDEO), "--corners", str(CORNERS)]
    command = shlex.join([*words, "--preset", preset, "--backend", backend])
    Path("command.txt").write_text(command + "\n", encoding="utf-8")
    # The page shows the video under a name of this run: browsers keep what they have seen.
    shown = views / f"tracked-{Path.cwd().name}.mp4"
    shown.hardlink_to(VIDEO)
    return TrackingOutcome(Path.cwd(), shown, tuple(rows), seconds / len(rows), tuple(reader.notes), command)
