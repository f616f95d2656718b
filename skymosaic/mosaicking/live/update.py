"""What became of a frame that a live mosaic was given."""

from dataclasses import dataclass
from typing import Any

from golden_model.arrays import Matrix, Records
from skymosaic.mosaicking.live.growing_flight import Placement


@dataclass(frozen=True, eq=False)
class LiveUpdate:
    """Result of adding one frame.

    Attributes
    ----------
    number : int
        The frame's number, from 0.
    name : str
    seconds : float
        When it was placed or left out, since the mosaic was begun.
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

    def summary(self) -> dict[str, Any]:
        """The frame in plain numbers, as ``live --json`` prints it."""
        return {
            "frame": self.number,
            "name": self.name,
            "seconds": round(self.seconds, 3),
            "placed": not self.reason,
            "reason": self.reason,
            "pose": None if self.transform is None else self.transform.tolist(),
            "ties": self.placement.ties if self.placement else 0,
            "error_px": self.placement.error_px if self.placement else None,
            "parts": self.parts,
        }
