"""Reads where a drone was from the subtitles (.SRT) that it writes beside a video."""

import re
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from golden_model.small_files import read_small_file
from skymosaic.imagery.exif import Position, on_globe

MAX_BYTES = 128 << 20
"""Room for two hours at 60 frames per second."""
MAX_OFF_S, MAX_OFF = 2.0, 0.02
"""Subtitles of the same video end as it does, within this time or this share of its length."""
_CUE = re.compile(r"(\d+):(\d\d):(\d\d)[,.](\d{3})\s*-->\s*(\d+):(\d\d):(\d\d)[,.](\d{3})")
# Some firmware misspells it.
_NAMED = re.compile(r"latitude\s*:\s*([-+]?[\d.]+).*?longt?itude\s*:\s*([-+]?[\d.]+)", re.DOTALL | re.IGNORECASE)
_PAIR = re.compile(r"GPS\s*\(\s*([-+]?[\d.]+)\s*,\s*([-+]?[\d.]+)\s*,[^)]*?(M?)\s*\)")
"""Longitude and latitude; the other way round from the drones that write the height's unit."""


def read_track(video: Path, length_s: float, tell: Callable[[str], None]) -> Callable[[float], Position] | None:
    """The position at each second of a video of ``length_s``, 0: unknown; None without subtitles that fit it.

    ``tell`` receives a line if there are subtitles: that they are used, or why not.
    """
    beside = [path for suffix in (".SRT", ".srt") if (path := video.with_suffix(suffix)).is_file()]
    if not beside:
        return None
    try:
        text = read_small_file(beside[0], MAX_BYTES).decode("utf-8", "replace")
    except OSError as error:
        tell(f"{beside[0]} cannot be read ({error.strerror}), and gives no positions")
        return None
    cues = list(_read_cues(text))
    known = sorted((start_s, *place.degrees) for start_s, _, place in cues if place is not None)
    if not known:
        tell(f"{beside[0]} has no positions")
        return None
    end_s = max(end_s for _, end_s, _ in cues)
    if length_s and abs(end_s - length_s) > max(MAX_OFF_S, MAX_OFF * length_s):
        tell(f"{beside[0]} lasts {end_s:.0f} s, the video {length_s:.0f} s: it is of another, and gives no positions")
        return None
    tell(f"positions are those of {beside[0]}")
    starts_s, longitudes_deg, latitudes_deg = np.array(known).T
    return lambda second: Position(
        *(float(np.interp(second, starts_s, each)) for each in (latitudes_deg, longitudes_deg))
    )


def _read_cues(text: str) -> Iterator[tuple[float, float, Position | None]]:
    """When each subtitle begins and ends, s, and its position."""
    cues = list(_CUE.finditer(text))
    for cue, end in zip(cues, [*(each.start() for each in cues[1:]), len(text)], strict=True):
        hours, minutes, seconds, milliseconds = np.array(cue.groups(), np.float64).reshape(2, 4).T
        start_s, end_s = (3600 * hours + 60 * minutes + seconds + milliseconds / 1000).tolist()
        yield start_s, end_s, _find_position(text[cue.end() : end])


def _find_position(text: str) -> Position | None:
    named, pair = _NAMED.search(text), _PAIR.search(text)
    try:
        if named is not None:
            return on_globe(float(named[1]), float(named[2]))
        if pair is not None:
            first, second = float(pair[1]), float(pair[2])
            return on_globe(first, second) if pair[3] else on_globe(second, first)
    # Two points in a number.
    except ValueError:
        pass
    return None
