"""Runs a live mosaic: it grows while frames come, with a preview that follows."""

import time
from collections.abc import Callable, Iterable
from pathlib import Path

from skymosaic.common.errors import AppearedError, InputError
from skymosaic.imagery.images import save
from skymosaic.imagery.live_frames import LiveFrame
from skymosaic.mosaicking.live.kept_frames import FullError
from skymosaic.mosaicking.live.mosaic import LiveMosaic

PREVIEW_SECONDS = 1.0
"""Least time between two previews."""
PREVIEW_SHARE = 0.1
"""Share of the run's time that previews may take: each shows all frames."""


def grow(mosaic: LiveMosaic, frames: Iterable[LiveFrame], preview: Path, tell: Callable[[str], None]) -> None:
    """Add frames as they come, until they end or no more can be kept.

    The preview is written anew while the mosaic grows. It is a convenience: one that cannot be written ends nothing.
    ``tell`` receives a line then, or if no more frames can be kept.

    Raises
    ------
    AppearedError
        If a file has come under the preview's name that must not be replaced.
    """
    due_s = 0.0
    for frame in frames:
        try:
            update = mosaic.add(frame.photograph, file=frame.file, taken=frame.taken, stamp=frame.stamp)
        except FullError as error:
            tell(f"stopped: {error}")
            break
        if not update.reason and (start_s := time.monotonic()) >= due_s:
            _write_preview(mosaic, preview, tell)
            end_s = time.monotonic()
            due_s = end_s + max(PREVIEW_SECONDS, (end_s - start_s) / PREVIEW_SHARE)
    if mosaic.transforms:
        _write_preview(mosaic, preview, tell)


def _write_preview(mosaic: LiveMosaic, path: Path, tell: Callable[[str], None]) -> None:
    try:
        save(path, mosaic.preview)
    # Another picture, perhaps the preview of another run with these names: neither of them is to be lost.
    except AppearedError:
        raise
    except InputError as error:
        path.unlink(missing_ok=True)
        tell(f"note: no preview: {error}")
