"""Videos among the photographs of a flight: replaces each by its key frames, stored in a temporary folder."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from golden_model.arrays import Pixels
from skymosaic.imagery.images import save
from skymosaic.imagery.photographs import Source, list_sources
from skymosaic.imagery.video import VIDEO_SUFFIXES, VideoReader, select_key_frames
from skymosaic.temporary import temporary_folder


def is_video(image: str | Path | Pixels) -> bool:
    """Whether a file's suffix is that of a video."""
    return isinstance(image, str | Path) and Path(image).suffix.lower() in VIDEO_SUFFIXES


@contextmanager
def flight_sources(
    images: Sequence[str | Path | Pixels], tell: Callable[[str], None] = lambda _line: None
) -> Iterator[list[Source]]:
    """As `skymosaic.imagery.photographs.list_sources`, with each video replaced by its key frames.

    The key frames are JPEG files in a temporary folder, which is deleted when the context ends.

    Parameters
    ----------
    images : sequence of str, Path or ndarray
        Files, folders, videos and arrays.
    tell : callable
        Receives one line per note about a video, for instance that it was cut off.

    Raises
    ------
    InputError
        As in `list_sources`; also for a video that cannot be read, or a full disk.
    """
    with temporary_folder() as folder:
        found: list[Source] = []
        for image in images:
            if is_video(image):
                frames = folder / str(len(found))
                frames.mkdir()
                found += _key_frames(Path(str(image)), frames, tell)
            else:
                found += list_sources([image])
        yield [dataclasses.replace(source, index=index) for index, source in enumerate(found)]


def _key_frames(video: Path, folder: Path, tell: Callable[[str], None]) -> Iterator[Source]:
    reader = VideoReader(video)
    for frame in select_key_frames(reader):
        path = folder / f"{frame.number}.jpg"
        save(path, frame.pixels)
        yield Source(0, str(video / f"frame {frame.number}"), path)
    for note in reader.notes:
        tell(f"note {video}: {note}")
