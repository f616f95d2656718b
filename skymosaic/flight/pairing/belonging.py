"""What belongs to a flight: another program's map, or a contact sheet, lies in many folders of photographs."""

from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path

from skymosaic.flight.linking.view import View

MIN_PHOTOGRAPHS = 6
"""Of fewer, nothing is usual."""
MIN_USUAL = 0.8
"""Share of the photographs that a property must have to be usual."""
MIN_DIFFERENCES = 3
"""What lacks this many usual properties is no photograph of the flight; another camera's, or a cropped one, lacks two.
"""
MAX_ALIKE = 2
"""More of one size are from another source, such as the frames of a video."""


def find_strangers(views: Sequence[View]) -> dict[int, str]:
    """Find what differs from nearly all others in several properties: size, kind of file, alpha, GPS, focal length.

    Returns the reasons by the indices of the views.
    """
    if len(views) < MIN_PHOTOGRAPHS:
        return {}
    sizes = Counter(view.size for view in views)
    differences: dict[int, list[str]] = {index: [] for index in range(len(views))}
    for values in zip(*map(_describe, views), strict=True):
        usual, count = Counter(values).most_common(1)[0]
        # That others have GPS, too, is nothing by which one could tell a photograph.
        if count >= MIN_USUAL * len(views) and not usual.startswith("no "):
            for index, value in enumerate(values):
                if value != usual:
                    differences[index].append(f"{value} instead of {usual}")
    return {
        index: f"{views[index].name}: no photograph of this flight ({', '.join(found)}); `keep_all` takes it"
        for index, found in differences.items()
        if len(found) >= MIN_DIFFERENCES and sizes[views[index].size] <= MAX_ALIKE
    }


def _describe(view: View) -> Iterator[str]:
    """The properties of a photograph, in words, in a fixed order."""
    long, short = sorted(view.size, reverse=True)
    yield f"{long}x{short} px"
    yield Path(view.name).suffix.lower() or "no file"
    yield "all opaque" if view.visible is None else "transparent parts"
    yield "no GPS" if view.gps is None else "GPS"
    yield "no focal length" if view.taken.focal_half_diagonals is None else "a focal length"
