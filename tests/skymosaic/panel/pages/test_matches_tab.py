"""Which matches of a finished run are drawn, shown and explained."""

from collections.abc import Callable
from dataclasses import replace

import pytest
from nicegui import Client
from nicegui.page import page as nicegui_page

from skymosaic.panel.options import Options
from skymosaic.panel.pages.matches_tab import MatchesTab
from skymosaic.panel.results import Picture
from tests.skymosaic.panel import made_up
from tests.skymosaic.panel.visitor import Scenario


@pytest.fixture
def tab(run_in_loop: Callable[[Scenario], None]) -> MatchesTab:
    """Eight matches: one is rejected, one off the homography; the right picture begins at 332 px."""
    made: list[MatchesTab] = []

    async def build() -> None:
        with Client(nicegui_page("/matches"), request=None):
            pictures = Picture("/left", 320, 120), Picture("/right", 320, 120, 332)
            made.append(MatchesTab(made_up.pair("a.png", "b.png", Options.of_preset("aerial")), pictures))

    run_in_loop(build)
    return made[0]


def state(tab: MatchesTab) -> tuple[str, bool]:
    """What is said of the match shown, and whether it is explained."""
    return tab._number.text, "px from the homography" in tab._explanation.content


def test_hovering_explains_a_match_and_a_click_keeps_it(tab: MatchesTab) -> None:
    assert state(tab) == ("8 matches", False)
    tab._hover(40, 100.1, 1)
    assert state(tab) == ("match 1 of 8", True)
    # Nothing is within 10 px of the screen.
    tab._hover(40, 100.3, 1)
    tab._hover(70, 91, 2)
    assert state(tab) == ("match 1 of 8", True)
    tab._pick(70, 85, 1)
    tab._hover(40, 90, 1)
    assert state(tab) == ("match 2 of 8, pinned", True)
    tab._pick(5, 5, 1)
    assert state(tab) == ("8 matches", False)


def test_the_buttons_step_through_the_matches_that_are_drawn(tab: MatchesTab) -> None:
    shown = []
    for by in (1, 1, -1, -1, 1):
        tab._step(by)
        shown.append(tab._number.text)
    # The sixth is off the homography, the seventh rejected; only inliers are drawn.
    assert shown == [f"match {number} of 8, pinned" for number in (1, 2, 1, 8, 1)]
    tab._pick(5, 5, 1)
    tab._step(-1)
    assert tab._number.text == "match 8 of 8, pinned"
    pair = replace(tab._pair, matches=tab._pair.matches[:7])
    tab.show(pair)
    assert tab._number.text == "7 matches"
    tab._step(1)
    tab.show(pair)
    assert tab._number.text == "match 1 of 7, pinned"
    for checkbox in tab._filters.values():
        checkbox.value = False
    tab._step(1)
    assert tab._number.text == "match 1 of 7, pinned"


def test_lines_are_spread_over_all_matches(tab: MatchesTab) -> None:
    tab._verdicts = ["rejected", *["inlier"] * 2000]
    counts = []
    for tab._density in range(8):
        chosen = tab._candidates()
        counts.append(len(chosen))
        assert (chosen[0], len({*chosen})) == (1, len(chosen))
        assert chosen[-1] > 2000 - 2000 / len(chosen)
    assert counts == [25, 50, 100, 200, 400, 800, 1600, 2000]
    tab._verdicts, tab._density = ["inlier"] * 26, 0
    assert tab._candidates() == [*range(25)]
    tab._verdicts = ["inlier"] * 25
    assert tab._candidates() == [*range(25)]
