"""Poses: homographies from the canvas to a frame, set by a host, or composed of the chip's own homographies.

A pose is nine integers with a common scale, so composing is three sums of products for each row, and one shift of all
nine afterwards, which keeps the largest at 37 bits whatever the number of links. Nothing is inverted: the pose of a
frame is the homography from its reference, times the pose of that. Points in front of the camera have a positive w.
"""

import enum
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from golden_model.formats import SQ
from golden_model.geometry.fixed_point import ENTRY, homography_elements

UNIT_LOG2 = 12
"""Coordinates of canvas and frame have the unit 2^12 px, as those of `golden_model.geometry.fixed_point.quantise`."""
POSE = SQ(38)
"""An element of a pose. Each link is rounded down; a thousand of them move a frame by less than a thousandth of a px,
and sums of three products still have 64 bits."""
ELEMENT = SQ(28)
"""An element as the tiles and their corners take it: the error in the frame is a thousandth of a pixel."""
SUM_SHIFT = 26
"""Bits that a sum of products drops to become an element; for a composed pose, at most."""
MIN_DETERMINANT = 1 << 40
"""2^-19 of the cube of the largest element that there can be; what rounding makes of 0 is below 2^38."""
MAX_LINKS = 255


class PoseCause(enum.IntFlag):
    """Why a pose is refused."""

    OUT_OF_RANGE = 1
    """An element has more than 25 bits."""
    SINGULAR = 2
    """The determinant is not positive, or too small: the frame is mirrored, a line, or the elements too coarse."""
    UNKNOWN_REFERENCE = 4
    """The homography starts at a frame whose pose is not kept."""
    UNANCHORED = 8
    """There are too many links from the last pose that a host set."""


@dataclass(frozen=True, eq=False)
class Placement:
    """What says where a frame is."""

    frame: int
    """The lower 16 bits of its number."""
    reference: int
    """Those of another frame's, whose pose stays kept."""
    elements: NDArray[np.integer]
    """(3, 3), as in a Homography record."""
    composed: bool
    """Whether the elements are the homography from the reference, and not the pose itself."""


def placement_of(record: np.void) -> Placement | None:
    """What a Homography record (`golden_model.records.HOMOGRAPHY`) says of its frame; nothing where it has causes."""
    if record["causes"]:
        return None
    elements = homography_elements(record)
    return Placement(int(record["frame"]) & 0xFFFF, int(record["reference"]), elements, composed=True)


@dataclass(frozen=True, eq=False)
class Kept:
    """A pose that others can be composed with."""

    frame: int
    pose: NDArray[np.int64]
    """(3, 3), `POSE`."""
    links: int
    """Homographies since the last pose that a host set."""


class Poses:
    """Keeps two poses: that of the reference, and that of the newest frame, which may become the next reference.

    A host whose pose comes late holds the reference until it has set it; then each frame after that has one link. A
    pose that is refused changes nothing.

    Parameters
    ----------
    max_links : int
        Homographies that may be composed after a host's pose, at most `MAX_LINKS`.
    """

    def __init__(self, max_links: int = MAX_LINKS) -> None:
        self._max_links = max_links
        self._places: list[Kept | None] = [None, None]
        self._newest = 0

    def place(self, placement: Placement) -> tuple[NDArray[np.int64] | None, PoseCause]:
        """Find the pose (3, 3) of a frame, in `POSE`; without one, say why."""
        known = self._find(placement.reference) if placement.reference != placement.frame else None
        base = self._places[known] if known is not None else None
        causes = self._causes(placement, base)
        if causes:
            return None, causes
        elements = np.asarray(placement.elements, dtype=np.int64)
        links = 0
        if placement.composed and base is not None:
            pose, links = compose(elements, base.pose), base.links + 1
        else:
            pose = elements << POSE.bits - ENTRY.bits
        if determinant(pose) < MIN_DETERMINANT:
            return None, PoseCause.SINGULAR
        own = self._find(placement.frame)
        # Without a reference, the older one goes.
        self._newest = own if own is not None else 1 - (self._newest if known is None else known)
        self._places[self._newest] = Kept(placement.frame, pose, links)
        return pose, PoseCause(0)

    def _find(self, frame: int) -> int | None:
        return next((n for n, each in enumerate(self._places) if each is not None and each.frame == frame), None)

    def _causes(self, placement: Placement, base: Kept | None) -> PoseCause:
        causes = PoseCause(0) if ENTRY.holds(placement.elements) else PoseCause.OUT_OF_RANGE
        if placement.composed and base is None:
            causes |= PoseCause.UNKNOWN_REFERENCE
        if placement.composed and base is not None and base.links >= self._max_links:
            causes |= PoseCause.UNANCHORED
        return causes


def compose(homography: NDArray[np.int64], pose: NDArray[np.int64]) -> NDArray[np.int64]:
    """Compose a homography (3, 3) in `ENTRY`, from a reference to a frame, with the pose of that reference."""
    sums: NDArray[np.int64] = homography @ pose
    largest = int(np.bitwise_or.reduce(np.where(sums < 0, ~sums, sums), axis=None))
    return sums >> max(largest.bit_length() - (POSE.bits - 1), 0)


def determinant(pose: NDArray[np.int64]) -> int:
    """Determinant of a pose, of which one factor is cut to 25 bits in each product; 2^59 is that of elements near 1."""
    cut = pose >> POSE.bits - ENTRY.bits
    second, third = cut[1], pose[2]
    after, before = np.roll(np.arange(3), -1), np.roll(np.arange(3), 1)
    minors = second[after] * third[before] - second[before] * third[after] >> SUM_SHIFT
    return int(cut[0] @ minors)


def elements(pose: NDArray[np.int64]) -> NDArray[np.int64]:
    """Cut a pose to `ELEMENT`."""
    return pose >> POSE.bits - ELEMENT.bits
