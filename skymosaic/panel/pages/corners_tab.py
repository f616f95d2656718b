"""Shows the corners of the first two photographs, and detects them again when an option changes them."""

import asyncio
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np
from nicegui import background_tasks, ui

from golden_model.arrays import Pixels, Records
from skymosaic.common.stopwatch import Stopwatch
from skymosaic.panel.options import Options, fault_of
from skymosaic.panel.pages import drawings
from skymosaic.panel.results import Decoded, Picture, side_by_side
from skymosaic.panel.session import Session
from skymosaic.panel.widgets import Viewer
from skymosaic.registration.extraction import extract_within_capacity

_AFFECTED_BY = ("preset", "detector", "descriptor", "position")


class CornersTab:
    """The first two photographs with their corners, and the number of corners."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self._photographs: tuple[Decoded, ...] = ()
        self._drawn: tuple[object, ...] = ()
        self._detecting = False
        self._viewer: Viewer | None = None
        with ui.element("div").classes("bar"):
            self._counts = ui.label().classes("name").props('role="status" aria-label="Corners found"')
            ui.html(
                '<i class="key level-0"></i>full size <i class="key level-1"></i>half size', sanitize=False
            ).classes("hint")
            self._hint = ui.label().classes("hint")
        self._container = ui.element("div")

    def update(self) -> None:
        """Show the first two photographs as they are now, and their corners for the current options."""
        count = len(self._session.inputs.photographs)
        which = f"The first two of {count} photographs. " if count > 2 else ""
        self._hint.set_text(f"{which}The tick is the orientation. Move the threshold: the corners follow.")
        first = [photograph.decoded for photograph in self._session.inputs.photographs[:2]]
        photographs = tuple(each for each in first if each)
        if photographs != self._photographs:
            self._photographs = photographs
            self._container.clear()
            self._viewer = None
            if photographs:
                with self._container:
                    self._viewer = Viewer("Corners of the photographs", self._place())
        if self._viewer is not None and not self._detecting:
            background_tasks.create(self._detect_and_draw(), name="corners")

    async def _detect_and_draw(self) -> None:
        """Detect and draw until the drawing matches the options.

        Positions that the slider passes while a detection runs are never computed.
        """
        self._detecting = True
        try:
            while (inputs := self._inputs()) != self._drawn and not fault_of(self._session.options):
                clock = Stopwatch()
                pictures = [each.working for each in self._photographs]
                try:
                    features = await asyncio.to_thread(detect, pictures, self._session.options)
                except FileNotFoundError:
                    # Their files go with photographs that are replaced, and with the session.
                    if self._photographs in ((), inputs[: len(pictures)]):
                        return
                    continue
                # The photographs may have been replaced meanwhile.
                if inputs[: len(features)] == self._photographs:
                    self._draw(features, clock.lap("corners"))
                    self._drawn = inputs
        finally:
            self._detecting = False

    def _inputs(self) -> tuple[object, ...]:
        """Everything the drawing depends on."""
        return (*self._photographs, *(getattr(self._session.options, name) for name in _AFFECTED_BY))

    def _place(self) -> tuple[Picture, ...]:
        return side_by_side((each.working, each.working_size) for each in self._photographs)

    def _draw(self, features: list[Records], seconds: float) -> None:
        if self._viewer is not None:
            pairs = zip(features, self._place(), strict=True)
            self._viewer.draw("".join(drawings.draw_corners(corners, picture.x) for corners, picture in pairs))
        counts = " and ".join(str(len(corners)) for corners in features)
        self._counts.set_text(f"{counts} corners, detected in {1000 * seconds:.0f} ms")


def detect(pictures: Sequence[Path], options: Options) -> list[Records]:
    """Detect the features of working pictures; one array of records each, equal to that of a run with these options."""
    method, config = options.choose_method()
    front_end = options.changed("backend", "golden").open_backend(method)
    while True:
        results = [extract_within_capacity(front_end, [_read(picture)], config) for picture in pictures]
        raised = next((used for _, used in results if used != config), None)
        if raised is None:
            return [result.features for (result,), _ in results]
        # A threshold that was raised for one picture applies to all, as in a run.
        config = raised


# The slider asks for the same pictures again and again.
@lru_cache(maxsize=8)
def _read(picture: Path) -> Pixels:
    pixels = cv2.imdecode(np.fromfile(picture, np.uint8), cv2.IMREAD_UNCHANGED)
    return np.asarray(pixels, dtype=np.uint8)
