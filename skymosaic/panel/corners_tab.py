"""The corners of the two photographs at hand, found again whenever a choice that moves them changes."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np
from nicegui import background_tasks, ui

from golden_model.arrays import Pixels, Records
from skymosaic.features.methods import backend_of
from skymosaic.panel import drawings
from skymosaic.panel.options import Options, fault_of
from skymosaic.panel.results import Upload
from skymosaic.panel.sessions import Session
from skymosaic.panel.viewer import Viewer, side_by_side
from skymosaic.registration import extract_within_capacity

_Wanted = tuple[tuple[Upload, ...], Options]
_MOVED_BY = ("preset", "detector", "descriptor", "position")


class CornersTab:
    """Two pictures with their corners, and how many there are."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self._photographs: tuple[Upload, ...] = ()
        self._drawn: tuple[object, ...] = ()
        self._following = False
        self._viewer: Viewer | None = None
        with ui.element("div").classes("bar"):
            self._counts = ui.label().classes("name").props('role="status" aria-label="Corners found"')
            ui.html(
                '<i class="key level-0"></i>full size <i class="key level-1"></i>half size', sanitize=False
            ).classes("hint")
            ui.label("The tick is the orientation. Move the threshold: the corners follow.").classes("hint")
        self._place = ui.element("div")

    def update(self) -> None:
        """Show the first two photographs there are now, with the corners of the options made now."""
        photographs = tuple(self._session.photographs[:2])
        if photographs != self._photographs:
            self._photographs = photographs
            self._place.clear()
            self._viewer = None
            if photographs:
                pictures = [(f"/picture/{upload.working.name}", upload.working_size) for upload in photographs]
                with self._place:
                    self._viewer = Viewer("Corners of the photographs", side_by_side(pictures, drawings.GAP_PX))
        if self._viewer is not None and not self._following:
            background_tasks.create(self._follow(), name="corners")

    async def _follow(self) -> None:
        """Detect and draw until what is drawn is what is wanted; what was skipped meanwhile is never computed."""
        self._following = True
        try:
            while (wanted := self._wanted()) != self._drawn and not fault_of(self._session.options):
                started = time.perf_counter()
                pictures = [upload.working for upload in self._photographs]
                found = await asyncio.to_thread(detect, pictures, self._session.options)
                if wanted[: len(found)] == self._photographs:  # else others have been chosen meanwhile
                    self._draw(found, time.perf_counter() - started)
                    self._drawn = wanted
        finally:
            self._following = False

    def _wanted(self) -> tuple[object, ...]:
        return (*self._photographs, *(getattr(self._session.options, name) for name in _MOVED_BY))

    def _draw(self, found: list[Records], seconds: float) -> None:
        offset, drawing = 0, ""
        for upload, features in zip(self._photographs, found, strict=True):
            drawing += drawings.corners(features, offset)
            offset += upload.working_size[0] + drawings.GAP_PX
        if self._viewer is not None:
            self._viewer.draw(drawing)
        counts = " and ".join(str(len(features)) for features in found)
        self._counts.set_text(f"{counts} corners, found in {1000 * seconds:.0f} ms")


def detect(pictures: Sequence[Path], options: Options) -> list[Records]:
    """The corners of working pictures, as a run with these options would find them."""
    method, config = options.resolve()
    front_end = backend_of(method, "golden")
    while True:
        results = [extract_within_capacity(front_end, [_pixels(picture)], config) for picture in pictures]
        raised = next((settled for _, settled in results if settled != config), None)
        if raised is None:
            return [result.features for (result,), _ in results]
        config = raised  # a threshold that had to be raised for one picture holds for all


@lru_cache(maxsize=8)
def _pixels(picture: Path) -> Pixels:
    return np.asarray(cv2.imread(str(picture), cv2.IMREAD_UNCHANGED), dtype=np.uint8)
