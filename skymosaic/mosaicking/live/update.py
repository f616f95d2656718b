"""What became of a frame that a live mosaic was given."""

from dataclasses import dataclass
from typing import Any

from golden_model.arrays import Matrix, Records
from golden_model.text import one_line
from skymosaic.mosaicking.live.growing_flight import Placement


@dataclass(frozen=True, eq=False, repr=False)
class LiveUpdate:
    """Result of adding one frame.

    Attributes
    ----------
    number : int
        The frame's number, from 0.
    name : str
    seconds : float
        When it was placed or left out, since the mosaic was begun.
    stamp : float or None
        When it was taken, s, as `LiveMosaic.add` was told.
    transform : ndarray of float64, shape (3, 3), or None
        Its original pixels to the reference frame of its part; None if it was left out. Later frames may refine it.
    placement : Placement or None
        Its registration; None if it began a part or was left out.
    reason : str
        Why it was left out; else empty.
    parts : int
        Number of parts after this frame.
    size_px : tuple of int
        Width and height of the frame as registered.
    features : structured ndarray or None
        Its features; None if the frame could not be used.
    part : int or None
        The part that it is in, named by the number of the frame that began it; None if it was left out. Poses of
        different parts lie in different reference frames.
    joined : tuple of int
        Parts that it has joined to its own: from now on, their frames lie in the reference frame of that.
    """

    number: int
    name: str
    seconds: float
    transform: Matrix | None
    placement: Placement | None
    reason: str
    parts: int
    size_px: tuple[int, int] = (0, 0)
    features: Records | None = None
    part: int | None = None
    joined: tuple[int, ...] = ()
    stamp: float | None = None

    def __str__(self) -> str:
        """What became of the frame, as ``live`` prints it."""
        if self.reason:
            return f"left out: {self.reason}"
        joined = "".join(f"; joins part {part}" for part in self.joined)
        parts = f"{joined}; {self.parts} separate parts" if self.parts > 1 else joined
        if self.placement is None:
            return f"starts a separate mosaic{parts}"
        neighbours = ", ".join(map(str, self.placement.neighbours))
        return f"{self.placement.ties} ties to {neighbours}, median {self.placement.error_px:.2f} px{parts}"

    def __repr__(self) -> str:
        """One line with the number, the name, the part and what became of the frame."""
        where = "" if self.part is None else f" in part {self.part}"
        return one_line(f"LiveUpdate({self.number} {self.name}{where}: {self})")

    def summary(self) -> dict[str, Any]:
        """The frame in plain numbers, as ``live --json`` prints it."""
        return {
            "frame": self.number,
            "name": self.name,
            "seconds": round(self.seconds, 3),
            "time": self.stamp,
            "placed": not self.reason,
            "reason": self.reason,
            "pose": None if self.transform is None else self.transform.tolist(),
            "part": self.part,
            "joined": list(self.joined),
            "neighbours": list(self.placement.neighbours) if self.placement else [],
            "ties": self.placement.ties if self.placement else 0,
            "error_px": self.placement.error_px if self.placement else None,
            "parts": self.parts,
        }
