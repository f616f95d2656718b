"""Finished runs are listed, read and deleted."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import httpx
import pytest
from nicegui import Client
from nicegui.page import page as nicegui_page

from skymosaic.panel.pages.runs_page import build_runs_page
from skymosaic.panel.runs import Runs
from skymosaic.panel.session import Session
from tests.skymosaic.panel.visitor import Scenario

TITLE = "3 photographs: <b>a flight</b>"


@pytest.fixture
def finished(tmp_path: Path) -> Path:
    """What a run has made."""
    (tmp_path / "run" / "report").mkdir(parents=True)
    (tmp_path / "run" / "report" / "index.html").write_text("<title>a report</title>")
    (tmp_path / "run" / "mosaic.png").write_bytes(b"pixels")
    (tmp_path / "run" / "tiles").mkdir()
    (tmp_path / "run" / "tiles" / "index.html").write_text("<title>a map</title>")
    return tmp_path / "run"


def test_a_run_is_listed_and_deleted(session: Session, finished: Path, run_in_loop: Callable[[Scenario], None]) -> None:
    run = session.runs.keep(finished, TITLE)

    async def scenario() -> None:
        with Client(nicegui_page("/runs"), request=None) as client:
            build_runs_page(session)
        said = {getattr(each, "text", ""): each for each in client.elements.values()}
        assert said[TITLE].visible
        assert said["mosaic.png"].props["href"] == f"/run/{run.name}/mosaic.png"
        assert said["tiles"].props["href"] == f"/run/{run.name}/tiles/index.html"
        press: Any
        (press,) = said["Delete"]._event_listeners.values()
        press.handler(None)
        assert run.exists(), "once is not enough"
        assert getattr(said["Delete"], "text", "") == "Delete for good"
        press.handler(None)
        assert TITLE not in {getattr(each, "text", "") for each in client.elements.values()}

    run_in_loop(scenario)
    assert not run.exists()


def test_files_of_a_run_are_sent_and_no_others(
    panel: str, owner_address: str, kept: Path, tmp_path: Path, finished: Path
) -> None:
    run = Runs(kept, tmp_path).keep(finished, TITLE)
    with httpx.Client(base_url=panel) as owner:
        owner.get(owner_address)
        assert owner.get(f"/run/{run.name}/mosaic.png").content == b"pixels"
        assert owner.get(f"/run/{run.name}/report/index.html").text == "<title>a report</title>"
        for path in (f"/run/{run.name}/..%2f..%2fsecret", f"/run/..%2f/{run.name}", "/run/../archive"):
            assert owner.get(path).status_code == 404
