"""The editor of the fuzzy rules: curves with corners to drag, the text, and what a change does to the pair shown."""

import asyncio
from collections.abc import Awaitable, Callable
from functools import partial

import numpy as np
from nicegui import run, ui

from skymosaic.panel.pages.matches_tab import MatchesTab
from skymosaic.panel.results import EDITED_RULES
from skymosaic.panel.rules_edit import find_corners, move_corner
from skymosaic.panel.session import Session
from skymosaic.panel.widgets import Curves
from skymosaic.registration.pair import Pair

CURVE_POINTS = 129
TYPING_PAUSE_S = 0.5


class RulesEditor:
    """Changes the rules of the pair that is shown; the tab's matches follow."""

    def __init__(self, session: Session, matches: MatchesTab) -> None:
        assert session.rules_edit is not None
        self._session, self._edit, self._matches = session, session.rules_edit, matches
        self._first = self._edit.pair
        self._wanted: tuple[str, int | None] | None = None
        # What was done first is tried first, an undo after the drag before it.
        self._turn = asyncio.Lock()
        # The rules and their version when a drag began: each of its steps moves the corner of these.
        self._dragged: tuple[str, int] | None = None
        with ui.expansion("Edit the rules", icon="tune").classes("rules-editor"):
            with ui.element("div").classes("bar"):
                for title, icon, action in (
                    ("Undo", "undo", partial(self._apply, self._edit.undo)),
                    ("Reset", "restart_alt", partial(self._apply, self._edit.reset)),
                    ("Save as FLL", "save", lambda: ui.download.content(self._edit.rules.text, EDITED_RULES)),
                    ("Use for the next run", "check", lambda: session.set_option("rules", self._edit.rules)),
                ):
                    button = ui.button(title, icon=icon, on_click=action).props("outline dense no-caps size=sm")
                    if title == "Undo":
                        self._undo_button = button
            self._effect = ui.label().classes("hint").props('role="status" aria-label="Effect of the rules"')
            self._fault = ui.label().classes("fault").props('role="alert"')
            with ui.element("div").classes("rules-columns"):
                with ui.element("div").classes("rules-curves"):
                    count = len(self._edit.rules.system.inputs)
                    moves = [(partial(self._move, n), partial(self._move, n, is_last=True)) for n in range(count)]
                    self._curves = [(ui.label().classes("name"), Curves(*each)) for each in moves]
                self._text = ui.textarea("Rules, in FLL", on_change=lambda event: self._type(event.value))
                self._text.props(f"outlined rows=20 debounce={1000 * TYPING_PAUSE_S:.0f} spellcheck=false")
                self._text.classes("rules-text")
        self._shown: Pair | None = None
        self._written = ""

    def update(self) -> None:
        """Show rules, matches and counts as they are now."""
        edit = self._edit
        self._fault.set_text(edit.fault)
        self._undo_button.set_enabled(edit.versions > 1 or bool(edit.fault))
        if self._dragged is None and self._wanted is None:
            for _, curves in self._curves:
                curves.release()
        if edit.pair is self._shown:
            return
        self._shown = edit.pair
        self._effect.set_text(f"{_describe(edit.pair)} (at first {_describe(self._first)})")
        self._matches.show(edit.pair)
        self._written = edit.rules.text
        self._text.set_value(self._written)
        system, shares = edit.rules.system, np.linspace(0, 1, CURVE_POINTS)
        for number, ((title, curves), variable) in enumerate(zip(self._curves, system.inputs, strict=True)):
            title.set_text(variable.name)
            drawn = []
            for name, term in variable.terms.items():
                degrees = term.degree(shares * variable.high)
                drawn.append((name, " ".join(f"{x:.4g},{y:.4g}" for x, y in zip(shares, degrees, strict=True))))
            corners = find_corners(system, number)
            terms = [", ".join(dict(corner.members)) for corner in corners]
            names = [f"Corner {at} of {variable.name}: {each}" for at, each in enumerate(terms, 1)]
            placed = [(corner.x, corner.y, name) for corner, name in zip(corners, names, strict=True)]
            curves.show(variable.name, variable.high, drawn, placed)

    async def _move(self, number: int, corner: int, x: float, y: float, *, is_last: bool = False) -> None:
        text, version = self._dragged or (self._edit.rules.text, self._edit.versions)
        self._dragged = None if is_last else (text, version)
        await self._change(move_corner(text, number, corner, x, y), after=version)

    def _type(self, text: str) -> Awaitable[None] | None:
        # What `update` writes comes here too, and the rules may be newer by then.
        return None if text == self._written else self._change(text)

    async def _apply(self, change: Callable[[], None]) -> None:
        async with self._turn:
            await run.io_bound(change)
        self._session.changed.emit()

    async def _change(self, text: str, *, after: int | None = None) -> None:
        """Try the rules that were wanted last; steps of a drag that come meanwhile are left out."""
        self._wanted = text, after
        await self._apply(self._try_wanted)

    def _try_wanted(self) -> None:
        wanted, self._wanted = self._wanted, None
        if wanted is not None:
            self._edit.change(wanted[0], after=wanted[1])


def _describe(pair: Pair) -> str:
    error = f"predicted error {pair.confidence.predicted_px:.2f} px" if pair.confidence else "no homography"
    return f"{len(pair.kept)} kept, {len(pair.matches) - len(pair.kept)} rejected, {error}"
