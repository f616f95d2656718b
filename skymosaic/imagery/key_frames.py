"""Videos among the photographs of a flight: each stands for its key frames, which lie on disk meanwhile."""

from __future__ import annotations

import dataclasses
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from golden_model.arrays import Pixels
from skymosaic.imagery.images import save
from skymosaic.imagery.photographs import Source, sources
from skymosaic.imagery.video import VIDEO_SUFFIXES, VideoReader, key_frames


def is_video(image: str | Path | Pixels) -> bool:
    """Whether an image is named like a video."""
    return isinstance(image, str | Path) and Path(image).suffix.lower() in VIDEO_SUFFIXES


@contextmanager
def flight_sources(
    images: Sequence[str | Path | Pixels], tell: Callable[[str], None] = lambda _line: None
) -> Iterator[list[Source]]:
    """`skymosaic.imagery.photographs.sources`, where a video gives its key frames.

    They are JPEG files in a temporary folder, for as long as the context lasts.

    Parameters
    ----------
    images : sequence of str, Path or ndarray
        Files, folders, videos and arrays.
    tell : callable
        Receives a line for whatever was noticed of a video, that it was cut off for instance.

    Raises
    ------
    InputError
        As `sources`; for a video that cannot be read, or a disk that is full.
    """
    with tempfile.TemporaryDirectory(prefix="skymosaic-") as folder:
        found: list[Source] = []
        for image in images:
            if is_video(image):
                place = Path(folder) / str(len(found))
                place.mkdir()
                found += _key_frames(Path(str(image)), place, tell)
            else:
                found += sources([image])
        yield [dataclasses.replace(source, index=index) for index, source in enumerate(found)]


def _key_frames(video: Path, folder: Path, tell: Callable[[str], None]) -> Iterator[Source]:
    reader = VideoReader(video)
    for frame in key_frames(reader):
        path = folder / f"{frame.number}.jpg"
        save(path, frame.pixels)
        yield Source(0, str(video / f"frame {frame.number}"), path)
    for note in reader.notes:
        tell(f"note {video}: {note}")
