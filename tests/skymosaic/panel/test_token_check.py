"""The panel has one owner, in any number of browsers; without the token a request is refused and nothing is stored."""

import re
from collections.abc import Iterator
from urllib.parse import urlsplit

import httpx
import pytest
from playwright.sync_api import Browser

from skymosaic.panel.token_check import REFUSAL
from tests.skymosaic.panel.visitor import noise_png
from tools.panel import open_page

PICTURE = re.compile(r"/picture/uploads/[\w.]+")


@pytest.fixture
def owners(panel: str, owner_address: str) -> Iterator[list[httpx.Client]]:
    """Two browsers without a screen that were given the address with the token."""
    browsers = [httpx.Client(base_url=panel, headers={"origin": panel}, timeout=None) for _ in range(2)]
    for browser in browsers:
        entered = browser.get(owner_address)
        assert (entered.status_code, entered.headers["location"]) == (303, "/")
        assert "httponly" in entered.headers["set-cookie"].lower()
    yield browsers
    for browser in browsers:
        browser.close()


def upload(client: httpx.Client) -> httpx.Response:
    return client.post("/upload/photograph", params={"name": "field.png"}, content=noise_png(96, seed=1))


def test_all_browsers_of_the_owner_show_the_same(owners: list[httpx.Client]) -> None:
    one, other = owners
    before = set(PICTURE.findall(other.get("/").text))
    assert upload(one).status_code == 204
    (shown,) = set(PICTURE.findall(other.get("/").text)) - before
    assert other.get(shown).content == one.get(shown).content != b""


@pytest.mark.parametrize("token", [None, "", "x", "{token}x", "ü"])
def test_without_the_token_nothing_is_shown_and_nothing_stored(
    owners: list[httpx.Client], panel: str, owner_address: str, token: str | None
) -> None:
    """As it is by a bookmark without the token, a guess, or with the cookie of a panel that has ended."""
    owner = owners[0]
    assert upload(owner).status_code == 204
    shown = PICTURE.findall(owner.get("/").text)
    given = None if token is None else token.format(token=owner_address.partition("=")[2]).encode()
    cookie = b"" if given is None else f"skymosaic_{urlsplit(panel).port}=".encode() + given
    headers = {b"origin": panel.encode(), b"cookie": cookie}
    with httpx.Client(base_url=panel, headers=headers, timeout=None) as stranger:
        assert upload(stranger).status_code == 403
        for path in ("/", "/tracking", "/runs", "/archive", shown[0], "/file/mosaic/mosaic.png", "/absent"):
            refused = stranger.get(path, params={"token": given} if given is not None and path == "/" else None)
            assert (refused.status_code, refused.text) == (403, f"{REFUSAL}\n"), path
            assert "frame-ancestors 'none'" in refused.headers["content-security-policy"]
            assert not refused.cookies
    assert PICTURE.findall(owner.get("/").text) == shown


def test_the_address_without_the_token_is_what_a_browser_keeps(
    browser: Browser, panel: str, owner_address: str
) -> None:
    stranger, page = open_page(browser, panel), open_page(browser, owner_address)
    assert stranger.locator("body").inner_text().strip() == REFUSAL
    for _ in range(2):
        assert page.url == f"{panel}/"
        assert page.get_by_role("button", name="Open a folder").is_visible()
        page.reload()
    stranger.context.close()
    page.context.close()
