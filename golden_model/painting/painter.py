"""Frames are painted onto a canvas one after the other: all steps joined."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from golden_model.arrays import Pixels
from golden_model.painting import windows
from golden_model.painting.blending import blend
from golden_model.painting.corners import project
from golden_model.painting.positions import positions
from golden_model.painting.sampling import sample
from golden_model.painting.tiles import TILE_PX, touched


@dataclass(frozen=True)
class Counts:
    """What became of the tiles that a frame may touch: one of four, or with ``replace`` all are painted.

    With ``replace`` those behind the camera or too large are painted with zeros, and counted twice.
    """

    offered: int
    """The frame may touch them; with ``replace`` all of the canvas."""
    behind: int
    """Not wholly in front of the camera."""
    too_large: int
    """They need more of the frame than a window has."""
    cannot_win: int
    """Nothing of the frame is in them, or every pixel of the canvas there is farther from its frame's border."""
    painted: int


@dataclass(frozen=True, eq=False)
class Plan:
    """What becomes of each of N tiles that a frame may touch, in the order in which they are painted."""

    tiles: NDArray[np.int64]
    """(N, 2), columns and rows."""
    corners: NDArray[np.int64]
    """(N, 3, 3, 2), `golden_model.painting.corners.project`."""
    boxes: NDArray[np.int64]
    """(N, 4), the part of the frame that each needs (`golden_model.painting.windows.cut_to_frame`)."""
    shown: NDArray[np.bool_]
    """(N,), those that may show something of the frame; their boxes have a meaning."""
    painted: NDArray[np.bool_]
    """(N,); those of them that are not shown are painted with zeros."""
    counts: Counts


class Painter:
    """A canvas, and the painting of frames onto it.

    Parameters
    ----------
    columns, rows : int
        Size of the canvas in tiles of 32 x 32 px, 1 to 128.
    replace : bool
        A frame forgets what was on the canvas, as stabilised video needs.

    Attributes
    ----------
    pages : uint8 ndarray, shape (1 or 2, rows, columns, 32, 32, 4)
        The tiles, as they lie in memory: blue, green, red and weight; weight 0 where nothing was painted. With
        ``replace`` there are two canvases: frames are painted into the one that is not shown, which is shown then.
    shown : int
        Which of them is shown.
    """

    def __init__(self, columns: int, rows: int, *, replace: bool = False) -> None:
        self.pages = np.zeros((1 + replace, rows, columns, TILE_PX, TILE_PX, 4), np.uint8)
        self.replace, self.shown = replace, 0
        self._least = np.zeros((rows, columns), np.int64)

    @property
    def memory(self) -> NDArray[np.uint8]:
        """The canvas that is shown, (rows, columns, 32, 32, 4)."""
        shown: NDArray[np.uint8] = self.pages[self.shown]
        return shown

    @property
    def picture(self) -> NDArray[np.uint8]:
        """The canvas (H, W, 4), row by row."""
        rows, columns = self.memory.shape[:2]
        return self.memory.swapaxes(1, 2).reshape(rows * TILE_PX, columns * TILE_PX, 4)

    def paint(self, frame: Pixels, pose: NDArray[np.int64]) -> Counts:
        """Paint a frame.

        Parameters
        ----------
        frame : uint8 ndarray, shape (H, W, 3)
            Blue, green, red.
        pose : int64 ndarray, shape (3, 3)
            From the canvas to the frame (`golden_model.painting.pose`).

        Returns
        -------
        Counts
        """
        height_px, width_px = frame.shape[:2]
        plan = self.plan((width_px, height_px), pose)
        self.shown = self.shown ^ int(self.replace)
        for n in np.flatnonzero(plan.painted):
            column, row = plan.tiles[n]
            self._paint_tile(frame, plan.corners[n], (row, column), shown=bool(plan.shown[n]))
        return plan.counts

    def plan(self, size: tuple[int, int], pose: NDArray[np.int64]) -> Plan:
        """Say what painting a frame of ``size`` (width, height), px, would do with each tile."""
        rows, columns = self.memory.shape[:2]
        tiles = touched(pose, size, (columns, rows), all_tiles=self.replace)
        corners, behind = project(pose, tiles)
        boxes = windows.bounding_boxes(corners)
        too_large = windows.are_too_large(boxes) & ~behind
        fits = ~behind & ~too_large
        column, row = tiles.T
        wins, shows = (
            windows.can_win(boxes, *size, least) for least in (self._least[row, column], np.zeros(len(tiles), np.int64))
        )
        painted = np.ones_like(fits) if self.replace else fits & wins
        counts = Counts(
            offered=len(tiles),
            behind=int(np.count_nonzero(behind)),
            too_large=int(np.count_nonzero(too_large)),
            cannot_win=0 if self.replace else int(np.count_nonzero(fits & ~wins)),
            painted=int(np.count_nonzero(painted)),
        )
        return Plan(tiles, corners, windows.cut_to_frame(boxes, *size), fits & shows, painted, counts)

    def _paint_tile(self, frame: Pixels, corners: NDArray[np.int64], place: tuple[int, int], *, shown: bool) -> None:
        colours, weights = sample(frame, positions(corners[np.newaxis])[0])
        if not shown:
            weights = np.zeros_like(weights)
        self.memory[place] = blend(self.memory[place], colours, weights, replace=self.replace)
        self._least[place] = self.memory[place][..., 3].min()
