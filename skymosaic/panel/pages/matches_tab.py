"""Shows the matches of a pair as lines, with an explanation of the one under the pointer."""

from collections.abc import Sequence

from nicegui import ui

from skymosaic.panel.explain import classify_matches, explain
from skymosaic.panel.pages import drawings
from skymosaic.panel.pages.page_layout import fill_in
from skymosaic.panel.results import Picture
from skymosaic.panel.widgets import Slider, Viewer
from skymosaic.registration.pair import Pair

KINDS = {"inlier": "kept, on the homography", "outlier": "kept, off it", "rejected": "rejected by the rules"}
REACH_SCREEN_PX = 10
DENSITIES = (25, 50, 100, 200, 400, 800, 1600)
"""Maximum number of lines, by the position of the slider; the last position draws all."""
DEFAULT_DENSITY = 2
"""More than 100 lines hide the photographs."""


class MatchesTab:
    """Two pictures, the lines between them, and why the chosen match was kept or rejected.

    Hovering explains the nearest match. A click pins it, so that the pointer can move away. The buttons step through
    all matches that are shown. At first these are some of the inliers, spread over the picture; the filters and the
    slider show more.
    """

    def __init__(self, pair: Pair, pictures: Sequence[Picture]) -> None:
        self._pictures = pictures
        self._density = DEFAULT_DENSITY
        self._chosen: int | None = None
        self._pinned = False
        # Without a homography there are no inliers: show what there is.
        drawn = ["inlier"] if len(pair.inliers) else [*KINDS]
        with ui.element("div").classes("bar"):
            self._filters = {
                kind: ui.checkbox(value=kind in drawn, on_change=self._draw).props("dense").classes(f"kind {kind}")
                for kind in KINDS
            }
            with ui.element("div").classes("density"):
                self._density_words = ui.label().classes("hint")
                self._slider = Slider(self._set_density)
            ui.element("div").classes("grow")
            with ui.element("div").classes("stepper"):
                ui.button(icon="chevron_left", on_click=lambda: self._step(-1)).props(
                    'flat round dense aria-label="Previous match"'
                )
                self._number = ui.label().classes("hint number").props('role="status" aria-label="Match shown"')
                ui.button(icon="chevron_right", on_click=lambda: self._step(1)).props(
                    'flat round dense aria-label="Next match"'
                )
        self._viewer = Viewer("Matches between the photographs", pictures)
        self._viewer.on_pointer("hover", self._hover)
        self._viewer.on_pointer("pick", self._pick)
        self._explanation = ui.html(sanitize=False).classes("explanation").props('aria-live="polite"')
        self.show(pair)

    def show(self, pair: Pair) -> None:
        """Show the pair, or the same with other verdicts; the chosen match stays."""
        self._pair, self._verdicts = pair, classify_matches(pair)
        self._lines = drawings.locate_matches(pair.matches, self._pictures[1].x)
        for kind, checkbox in self._filters.items():
            checkbox.set_text(f"{self._verdicts.count(kind)} {KINDS[kind]}")
        self._draw()
        self._choose(self._chosen if self._chosen is not None and self._chosen < len(self._verdicts) else None)

    def _set_density(self, position: int) -> None:
        self._density = position
        self._draw()

    def _draw(self) -> None:
        candidates = self._candidates()
        self._viewer.draw(drawings.draw_matches(self._lines, self._verdicts, candidates))
        words = f"{len(candidates)} lines"
        self._density_words.set_text(words)
        self._slider.show(
            lowest=0, highest=len(DENSITIES), position=self._density, label="Maximum number of lines", words=words
        )

    def _find_match(self, x: float, y: float, scale: float) -> int | None:
        candidates = self._candidates()
        nearest = drawings.find_nearest(self._lines[candidates], x, y, REACH_SCREEN_PX / scale)
        return None if nearest is None else candidates[nearest]

    def _candidates(self) -> list[int]:
        """The matches that are drawn; equal steps through the records spread them over the picture."""
        shown = [index for index, verdict in enumerate(self._verdicts) if self._filters[verdict].value]
        limit = DENSITIES[self._density] if self._density < len(DENSITIES) else len(shown)
        return shown if len(shown) <= limit else [shown[step * len(shown) // limit] for step in range(limit)]

    def _hover(self, *pointer: float) -> None:
        if not self._pinned and (index := self._find_match(*pointer)) is not None and index != self._chosen:
            self._choose(index)

    def _pick(self, *pointer: float) -> None:
        index = self._find_match(*pointer)
        self._pinned = index is not None
        self._choose(index)

    def _step(self, by: int) -> None:
        candidates = self._candidates()
        if candidates:
            before = candidates.index(self._chosen) if self._chosen in candidates else -1 if by > 0 else 0
            self._pinned = True
            self._choose(candidates[(before + by) % len(candidates)])

    def _choose(self, index: int | None) -> None:
        self._chosen = index
        if index is None:
            self._viewer.highlight("")
            self._number.set_text(f"{len(self._verdicts)} matches")
            self._explanation.set_content(
                '<p class="invite">Point at a line to read why that match was kept or rejected; click to pin it.</p>'
            )
            return
        self._viewer.highlight(drawings.draw_chosen_match(self._lines[index], self._verdicts[index]))
        pinned = ", pinned" if self._pinned else ""
        self._number.set_text(f"match {index + 1} of {len(self._verdicts)}{pinned}")
        self._explanation.set_content(fill_in("explanation.html", explanation=explain(self._pair, index)))
