"""The interface of everything that computes features: frames in, features and matches out."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Literal, Protocol, runtime_checkable

import numpy as np

from golden_model.arrays import Pixels, Records
from golden_model.config import Config

Reference = Literal["held", "previous"]
"""Which frame each later frame is matched with: the first of the run (a pair, a template) or the one before it."""

Progress = Callable[[str], None]
"""Receives one line of text when something slow starts, advances or ends."""


def silent(_line: str) -> None:
    """No-op progress callback."""


@dataclass(frozen=True)
class FrameClocks:
    """When a simulated frame passed the ports, in clocks since reset."""

    segment: int
    """Number of the run of frames that followed each other without a gap."""
    first_pixel: int
    """When its first pixel was taken."""
    features_end: int
    matches_end: int
    """When the last word of each packet was taken."""
    homography_end: int | None = None
    """The same of its homography; None without an estimator."""


@dataclass(frozen=True, eq=False)
class FrameResult:
    """The result for one frame."""

    features: Records
    """Feature records (`golden_model.records.feature_record`) in the order in which the hardware sends them."""
    matches: Records
    """Match records (`golden_model.records.MATCH`): left is the reference, right is this frame. Empty without one."""
    status: np.void
    """The FrameStatus record at the end of the features."""
    match_status: np.void
    """The FrameStatus record at the end of the matches."""
    cycles: int | None = None
    """Clocks from the first pixel in to the last word of features out; None for backends without a clock."""
    clocks: FrameClocks | None = None
    """None unless the result was simulated."""
    homography: np.void | None = None
    """The Homography record (`golden_model.records.HOMOGRAPHY`); None unless the configuration has an estimator."""

    @property
    def accepted(self) -> bool | None:
        """Whether a good frame's homography is accepted; None for a bad one, and without homographies."""
        return None if self.homography is None or not self.status["good"] else not self.homography["causes"]

    @classmethod
    def count_matches(cls, features: Records, matches: Records, status: np.void) -> FrameResult:
        """A result whose match status is ``status`` with the numbers of all matches and of those kept."""
        match_status = status.copy()
        match_status["matches"], match_status["kept"] = len(matches), np.count_nonzero(matches["verdict"])
        return cls(features, matches, status, match_status)


@dataclass(frozen=True)
class Mismatch:
    """The first difference between two results."""

    frame: int
    stage: str
    """A stage of the front end and its pyramid level, or a field of a record."""
    x: float | None
    y: float | None
    """Position in pixels: of the level for a stage, of the full frame for a record. For a count, the position of the
    first record that is missing or extra. None for a status."""
    expected: Any
    actual: Any

    def __str__(self) -> str:
        position = "" if self.x is None else f", x {self.x:g}, y {self.y:g}"
        return f"frame {self.frame}, {self.stage}{position}: expected {self.expected}, got {self.actual}"


@runtime_checkable
class Backend(Protocol):
    """Computes features and matches: the golden model, a simulation of the hardware, or a board.

    Attributes
    ----------
    takes_one_size : bool
        All frames of a run have one size, so that a pair is registered in one pass.
    """

    takes_one_size: ClassVar[bool] = False

    def run(self, frames: Sequence[Pixels], config: Config, *, reference: Reference = "held") -> list[FrameResult]:
        """Compute the features of each frame, and its matches with its reference; the first frame has no reference.

        Parameters
        ----------
        frames : sequence of uint8 ndarray, shape (H, W) or (H, W, 3) BGR
            Sizes may differ between frames, unless the backend takes one size.
        config : Config
            What to compute.
        reference : {"held", "previous"}
            Match each later frame with the first frame, or with the good frame before it; with an estimator, from the
            first accepted homography on, the last frame whose own is accepted.

        Raises
        ------
        ValueError
            For a frame that the configuration cannot process.
        BackendError
            If the backend cannot run.
        """
        ...

    def locate(self, image: Pixels, config: Config, *, frame: int) -> Mismatch | None:
        """Find the first stage of the front end that differs from the golden model.

        Parameters
        ----------
        image : uint8 ndarray, shape (H, W) or (H, W, 3) BGR
            The frame whose result differs.
        config : Config
            What was computed.
        frame : int
            Number of the frame, for the message.

        Returns
        -------
        Mismatch or None
            None if every stage agrees, or if the backend cannot show its stages, which is the default.
        """
        return None
