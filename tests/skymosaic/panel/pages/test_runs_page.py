"""Finished runs are listed, read and deleted by who has the token, and by nobody else."""

from pathlib import Path

import httpx
import pytest
from playwright.sync_api import Browser, expect

from skymosaic.panel.runs import Runs
from tools.panel.visit import open_page

TITLE = "3 photographs: <b>a flight</b>"


@pytest.fixture
def run(kept: Path, tmp_path: Path) -> Path:
    """A finished run of another day."""
    (tmp_path / "run" / "report").mkdir(parents=True)
    (tmp_path / "run" / "report" / "index.html").write_text("<title>a report</title>")
    (tmp_path / "run" / "mosaic.png").write_bytes(b"pixels")
    (tmp_path / "run" / "tiles").mkdir()
    (tmp_path / "run" / "tiles" / "index.html").write_text("<title>a map</title>")
    return Runs(kept, tmp_path).keep(tmp_path / "run", TITLE)


def test_a_run_is_listed_read_and_deleted(browser: Browser, owner_address: str, run: Path) -> None:
    page = open_page(browser, owner_address)
    page.get_by_role("link", name="Runs").click()
    expect(page.get_by_text(TITLE)).to_be_visible()
    card = page.locator(".card", has_text=TITLE)
    expect(card.get_by_role("link", name="mosaic.png")).to_be_visible()
    assert card.get_by_role("link", name="tiles").get_attribute("href") == f"/run/{run.name}/tiles/index.html"
    report = card.get_by_role("link", name="report").get_attribute("href")
    assert page.evaluate("address => fetch(address).then(answer => answer.text())", report) == "<title>a report</title>"
    card.get_by_role("button", name="Delete").click()
    assert run.exists(), "once is not enough"
    card.get_by_role("button", name="Delete for good").click()
    expect(page.get_by_text(TITLE)).to_have_count(0)
    assert not run.exists()
    page.context.close()


def test_without_the_token_no_run_is_seen(panel: str, owner_address: str, run: Path) -> None:
    address = f"/run/{run.name}/mosaic.png"
    with httpx.Client(base_url=panel) as visitor:
        assert visitor.get(address).status_code == 404
        assert TITLE not in visitor.get("/runs").text
        assert visitor.get("/?token=guess").status_code == 200
        assert visitor.get(address).status_code == 404
    with httpx.Client(base_url=panel) as owner:
        owner.get(owner_address)
        assert owner.get(address).content == b"pixels"
        for path in (f"/run/{run.name}/..%2f..%2fsecret", f"/run/..%2f/{run.name}", "/run/../archive"):
            assert owner.get(path).status_code == 404
