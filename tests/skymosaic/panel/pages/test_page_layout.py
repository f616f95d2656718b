"""What the pages are made of: templates, whose values are escaped, and all elements of every state, as recorded."""

import re
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from nicegui import Client, ui
from nicegui.page import page

from skymosaic.panel.folders import Roots
from skymosaic.panel.options import OWN, Options
from skymosaic.panel.pages.mosaic_page import build_mosaic_page
from skymosaic.panel.pages.runs_page import build_runs_page
from skymosaic.panel.pages.tracking_page import build_tracking_page
from skymosaic.panel.results import InputFile
from skymosaic.panel.runs import open_runs
from skymosaic.panel.session import Session
from tests.skymosaic.panel import made_up
from tests.skymosaic.panel.visitor import Scenario

RECORDED = Path(__file__).with_name("recorded_pages.txt")
"""What `record_pages` returns, without the folder and times of a run; a change that is meant changes it, too."""


def part(client: Client, name: str) -> list[str]:
    """All lines of a part of a page, by its accessible name or its class."""
    every = client.elements.values()
    (found,) = (each for each in every if each.props.get("aria-label") == name or name in each.classes)
    return list(made_up.describe(found))


def mosaic_pages(session: Session, folder: Path) -> Iterator[tuple[str, list[str]]]:
    """States of the mosaic page, each changed from the one before."""
    with Client(page("/"), request=None) as owner:
        build_mosaic_page(session)
    yield "welcome", list(made_up.describe(owner.content))
    session.inputs.photographs = [made_up.uploaded("a.png", "turned by 90 degrees"), made_up.uploaded("b.png")]
    session.options = Options.of_preset("aerial").changed("detector", "fast").changed("position", 20)
    steps: Any = SimpleNamespace(share=0.25, seconds_left=lambda: 12.4)
    job: Any = SimpleNamespace(title="Making the mosaic", line="registering: 1 of 4", seconds=4.2, steps=steps)
    session.job = job
    session.changed.emit()
    yield "a job runs", part(owner, "Photographs and options") + part(owner, "Results")
    steps.share, steps.seconds_left = None, lambda: None
    session.changed.emit()
    yield "without steps", part(owner, "running")
    session.job, session.fault = None, "no overlap"
    session._show_result(made_up.pair_result(folder))
    session.hardware_result = made_up.hardware_result()
    session.changed.emit()
    for switch in owner.elements.values():
        if isinstance(switch, ui.switch | ui.checkbox):
            switch.set_value(True)
    yield "a pair", part(owner, "run") + part(owner, "top") + part(owner, "results")
    assert session.rules_edit
    session.rules_edit.fault = "line 8: no number"
    session.inputs.photographs = [*session.inputs.photographs, made_up.uploaded("c.png")]
    session.changed.emit()
    yield "refused rules, and another photograph", part(owner, "rules-editor")[:12] + part(owner, "loaded")
    session.options = made_up.flight_result(folder).options
    session.inputs.unread = "1 picture is missing"
    session.inputs.photographs = [InputFile(f"/flight/{name}.png", Path(f"08/{name}.jpg")) for name in "abcdefg"]
    result = made_up.flight_result(folder / "flight")
    session._show_result(result)
    session.changed.emit()
    yield "a flight", part(owner, "Photographs and options") + part(owner, "results")
    (panels,) = (each for each in owner.elements.values() if isinstance(each, ui.tab_panels))
    panels.set_value("Matches")
    session._show_result(replace(result, pair=made_up.pair("b.png", "c.png", result.options)))
    session.changed.emit()
    yield "another pair of it", [next(made_up.describe(panels)), *part(owner, "pair-select")]
    lone = made_up.pair("a.png", "b.png", result.options, registered=False)
    session._show_result(replace(result, pair=lone, mosaic=None, reason="no overlap", links=()))
    session.inputs.photographs = []
    session.changed.emit()
    yield "no mosaic", part(owner, "results")
    session.mosaic_result, session.options = None, session.options.changed("rules", OWN)
    session.changed.emit()
    yield "closed", part(owner, "Results")


def other_pages(session: Session, folder: Path) -> Iterator[tuple[str, list[str]]]:
    """States of the tracking page and of the list of runs."""
    with Client(page("/tracking"), request=None) as client:
        build_tracking_page(session)
    yield "tracking", list(made_up.describe(client.content))
    template, video = made_up.uploaded("car.png"), made_up.uploaded("film.mp4", "25 frames/s")
    session.inputs.set_film({"template": template, "video": video})
    session.tracking_result = made_up.tracking_result(folder)
    session.changed.emit()
    yield "tracked", list(made_up.describe(client.content))
    for title in ("first", "second"):
        (folder / title).mkdir()
        (folder / title / "mosaic.tif").touch()
        kept = session.runs.keep(folder / title, title)
        (kept / "run.json").write_text(f'{{"title": "{title}", "finished": "2026-01-02 03:04"}}')
    with Client(page("/runs"), request=None) as client:
        build_runs_page(session)
    yield "runs", list(made_up.describe(client.content))


def record_pages(folder: Path) -> str:
    """All lines of all states; each stands where it comes first."""
    for name in ("mosaic.png", "report/index.html", "edited_rules.fll"):
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).touch()
    lines: dict[str, None] = {}
    with open_runs(folder / "kept") as runs:
        one, two = (Session(runs, Roots([folder]), ("board:pynq",)) for _ in range(2))
        pages = *mosaic_pages(one, folder), *other_pages(two, folder)
    for state, elements in (*pages, *made_up.explanations()):
        lines |= dict.fromkeys([f"== {state}, {len(elements)} lines", *map(str.rstrip, elements)])
    return "".join(f"{line}\n" for line in lines)


def test_every_page_has_the_elements_that_were_recorded(
    run_in_loop: Callable[[Scenario], None], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("nicegui.background_tasks.create", lambda task, **_: task.close())

    async def scenario() -> None:
        found = re.sub(r"\d+-\d+-\d{6}", "TIME", record_pages(tmp_path).replace(str(tmp_path), "FOLDER"))
        assert found.splitlines() == RECORDED.read_text(encoding="utf-8").splitlines()

    run_in_loop(scenario)
