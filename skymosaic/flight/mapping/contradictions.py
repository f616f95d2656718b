"""Doubts the place of a layout: two sources contradict each other, or one does not tell enough.

A source may be wrong while a fit to it alone looks well.
"""

from collections.abc import Iterator

import numpy as np

from golden_model.arrays import Points
from skymosaic.common.errors import InputError
from skymosaic.maps.georeference import Georeference, reproject

MAX_SCALE, REFUSED_SCALE = 0.03, 0.4
"""Difference of two scales, as a logarithm and beyond its uncertainty, that is a contradiction; one that is refused."""
MAX_TURN_DEG, REFUSED_TURN_DEG = 3.0, 30.0
MAX_AWAY_M, REFUSED_AWAY_M = 10.0, 1000.0
"""GPS is off by up to 5 m as a whole; a datum that was mistaken for another one moves a map by a few hundred."""
UNSURE_SCALE = 0.05
"""Whoever measures on a map does not expect more than this."""
MAX_HEIGHT_RATIO = 2.0
"""Heights are recorded above where the flight began, which may lie higher or lower than the ground."""
MAX_YAW_DEG, MOUNTED_DEG = 30.0, 15.0
"""Cameras are mounted turned by quarters, which the recorded yaw of an aircraft leaves out."""


def compare_places(one: Georeference, by_one: str, other: Georeference, by_other: str, places: Points) -> str:
    """How two georeferences of one layout contradict each other: scales, turn and distance; empty if they agree.

    The first is the one that is used; the second may be less exact, as its uncertainty says. ``by_one`` and
    ``by_other`` say what they are fitted to. ``places`` (N, 2) of the layout, px, are for instance those of its
    cameras; differences are those at their middle.

    Raises
    ------
    InputError
        If they contradict each other by so much that a map by either would be of no use.
    """
    middle = places.mean(axis=0)
    probe = np.stack([middle, middle + np.ptp(places, axis=0) + 1])
    remedy = "check names, pixels, coordinate system and order of the axes (east comes first)"
    try:
        first, second = (
            reproject(np.column_stack((probe, np.ones(2))) @ each.to_map[:2].T, each.crs, one.crs) @ [1, 1j]
            for each in (one, other)
        )
    # The map of one ends before the place of the other.
    except InputError:
        raise InputError(f"{by_one} and {by_other} contradict each other: the globe lies between; {remedy}") from None
    ratio = (second[1] - second[0]) / (first[1] - first[0])
    scale, turn_deg, away_m = abs(ratio), -np.degrees(np.angle(ratio)), abs(second[0] - first[0])
    # A first source that fits badly must not excuse itself. Two positions, which fit exactly, may be off by as much.
    unsure = float(np.nan_to_num(other.scale_error, nan=MAX_AWAY_M / abs(second[1] - second[0])))
    # A fit that leaves the scale uncertain by a share leaves the direction uncertain by the same angle.
    turn_allowed_deg, away_allowed_m = MAX_TURN_DEG + np.degrees(unsure), MAX_AWAY_M + other.residual_m
    if abs(np.log(scale)) <= MAX_SCALE + unsure and abs(turn_deg) <= turn_allowed_deg and away_m <= away_allowed_m:
        return ""
    text = (
        f"{by_one} and {by_other} contradict each other: {one.metres_per_pixel:.3g} and {other.metres_per_pixel:.3g} m "
        f"per pixel, {abs(turn_deg):.0f} degrees apart, {away_m:.0f} m away"
    )
    refused = abs(np.log(scale)) > REFUSED_SCALE + unsure, abs(turn_deg) > REFUSED_TURN_DEG + turn_allowed_deg
    if any(refused) or not away_m <= REFUSED_AWAY_M:
        raise InputError(f"{text}; {remedy}")
    return f"{text}; the map is by {by_one}: check names, pixels and coordinates"


def doubt_scale(on_map: Georeference) -> Iterator[str]:
    """A line for a scale that the positions or control points do not give well."""
    if on_map.scale_error > UNSURE_SCALE:
        yield (
            f"the scale of the map is known to ± {on_map.scale_error:.0%} only, by too few positions or too inexact "
            "ones; more photographs or control points give it better"
        )


def doubt_records(height_m: float | None, recorded_m: float | None, turned_deg: float | None) -> Iterator[str]:
    """A line each for a recorded height and a recorded yaw that contradict the positions.

    ``height_m`` is that by positions and focal length, ``turned_deg`` the turn of the photographs against the yaw.
    """
    if height_m and recorded_m and recorded_m > 0:
        ratio = height_m / recorded_m
        if not 1 / MAX_HEIGHT_RATIO <= ratio <= MAX_HEIGHT_RATIO:
            yield (
                f"flown at {height_m:.0f} m by positions and focal length, at {recorded_m:.0f} m by the recorded "
                "height: one of the three is wrong, or the ground lies far from where the flight began"
            )
    if turned_deg is not None and abs(turned_deg) > MAX_YAW_DEG and abs((turned_deg + 45) % 90 - 45) > MOUNTED_DEG:
        yield (
            f"positions and recorded yaw contradict each other: {abs(turned_deg):.0f} degrees apart; the map follows "
            "the positions"
        )
