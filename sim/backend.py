"""What every way of computing features looks like from outside: frames in, features and matches out."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from golden_model.config import Config

Reference = Literal["held", "previous"]
"""What a frame is matched with: the first frame of the run (a pair, a template) or the one before (a sequence)."""

BACKENDS = {
    "golden": "sim.golden",
    "rtl": "sim.verilator",
    "verilator": "sim.verilator",
    "cxxrtl": "sim.cxxrtl",
    "pysim": "sim.pysim",
    "board": "sim.board",
}
"""The module behind each name; ``rtl`` is the fastest simulation of the hardware."""

Progress = Callable[[str], None]
"""Receives one line of text when something slow starts, advances or ends."""


def silent(_line: str) -> None:
    """Progress that nobody wants to read."""


class BackendError(Exception):
    """A backend cannot do what it was asked: one line that names the thing, what is wrong and what to do."""


@dataclass(frozen=True, eq=False)
class FrameResult:
    """What came out for one frame.

    Parameters
    ----------
    features : structured ndarray
        Feature records (`golden_model.records.feature_record`) in the order of emission.
    matches : structured ndarray
        Match records (`golden_model.records.MATCH`), reference left, this frame right; empty without a reference.
    status : structured scalar
        The FrameStatus record that ended the features.
    match_status : structured scalar
        The FrameStatus record that ended the matches.
    cycles : int or None
        Clocks from the first pixel in to the last word out; None where there is no clock.
    """

    features: NDArray[np.void]
    matches: NDArray[np.void]
    status: np.void
    match_status: np.void
    cycles: int | None


@dataclass(frozen=True)
class Mismatch:
    """Where two results first differ.

    Parameters
    ----------
    frame : int
    stage : str
        A stage of the front end with its level, or a field of a record.
    x, y : float or None
        Position in pixels: of the stage's level for a stage, of the full frame for a record (the first one that is
        missing or too many, for a count); None for a status.
    expected, actual : object
        Both values.
    """

    frame: int
    stage: str
    x: float | None
    y: float | None
    expected: Any
    actual: Any

    def __str__(self) -> str:
        place = "" if self.x is None else f", x {self.x:g}, y {self.y:g}"
        return f"frame {self.frame}, {self.stage}{place}: expected {self.expected}, got {self.actual}"


class Backend(Protocol):
    """Computes features and matches: the golden model, a simulation of the hardware, or a board."""

    def run(
        self, frames: Sequence[NDArray[np.uint8]], config: Config, *, reference: Reference = "held"
    ) -> list[FrameResult]:
        """Features of each frame, and its matches with its reference; the first frame has none.

        Parameters
        ----------
        frames : sequence of uint8 ndarray, shape (H, W) or (H, W, 3) BGR
            Sizes may differ between frames.
        config : Config
            What to compute.
        reference : {"held", "previous"}
            Match every later frame with the first one, or with the one before it.

        Raises
        ------
        ValueError
            For a frame the configuration cannot take.
        BackendError
            If the backend cannot run.
        """
        ...

    def locate(self, image: NDArray[np.uint8], config: Config, *, frame: int) -> Mismatch | None:
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
            None if every stage agrees, or if the backend does not show its stages, which is the default.
        """
        return None


def load_backend(name: str, *, progress: Progress = silent, waves: Path | None = None) -> Backend:
    """The backend called ``name``.

    Parameters
    ----------
    name : str
        A key of `BACKENDS`; a board with its address, ``board:HOST[:PORT]``.
    progress : callable
        Receives a line of text when something slow (a first build) starts, advances or ends.
    waves : Path or None
        Where a simulation writes the waves of its runs (VCD); golden model and board have none.

    Raises
    ------
    BackendError
        For an unknown name, with the valid ones; a board without an address; waves that cannot be written.
    """
    kind, _, address = name.partition(":")
    if kind not in BACKENDS or (address and kind != "board"):
        raise BackendError(f"unknown backend {name!r}; valid: {', '.join(BACKENDS)}")
    if waves is not None:
        try:
            waves.touch()
        except OSError as error:
            raise BackendError(f"cannot write the waves to {waves}: {error.strerror}") from error
    # Imported on demand: the golden model needs neither Amaranth nor a compiler.
    load = importlib.import_module(BACKENDS[kind]).load
    backend: Backend = load(address, waves=waves) if kind == "board" else load(progress=progress, waves=waves)
    return backend
