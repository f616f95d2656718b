"""Requests that do not come from the panel's own page, or not from its owner, are refused and nothing is stored."""

import asyncio
import base64
import os
import re
import socket
from collections.abc import Iterator
from typing import Any
from urllib.parse import urlsplit

import httpx
import pytest
from playwright.sync_api import Browser
from starlette.responses import PlainTextResponse

from skymosaic.panel.access import NO_TOKEN, AccessCheck
from tests.skymosaic.panel.visitor import enter, noise_png, upload
from tools.panel import open_page

OWN = object()
PICTURE = re.compile(r"/picture/uploads/[\w.]+")
REFUSAL = f"refused: {NO_TOKEN}"
WEBSOCKET_PATH = "/_nicegui_ws/socket.io/?EIO=4&transport=websocket"


def status(address: str, method: str, path: str, *, host: object = OWN, origin: object = OWN, **headers: str) -> int:
    """The status code of a request of the owner, with any headers, also those that client libraries refuse to send."""
    authority, token = urlsplit(address).netloc, address.partition("token=")[2]
    lines = [f"{method} {path} HTTP/1.1", f"Host: {authority if host is OWN else host}", "Connection: close"]
    lines.append(f"Cookie: skymosaic_{urlsplit(address).port}={token}")
    if origin is not None:
        lines.append(f"Origin: {f'http://{authority}' if origin is OWN else origin}")
    lines += [f"{name.replace('_', '-')}: {value}" for name, value in headers.items()]
    name, port = authority.split(":")
    with socket.create_connection((name, int(port))) as connection:
        connection.sendall("\r\n".join([*lines, "", ""]).encode())
        return int(connection.recv(64).split()[1])


def websocket_status(address: str, **changed: Any) -> int:
    key = base64.b64encode(os.urandom(16)).decode()
    headers = {"Upgrade": "websocket", "Sec_WebSocket_Key": key, "Sec_WebSocket_Version": "13"}
    return status(address, "GET", WEBSOCKET_PATH, **changed, **headers, Connection="Upgrade")


def test_the_panels_own_page_and_socket_are_served_also_as_localhost(owner_address: str) -> None:
    assert status(owner_address, "GET", "/") == 200
    assert websocket_status(owner_address) == 101
    port = urlsplit(owner_address).port
    names = {"host": f"localhost:{port}", "origin": f"http://localhost:{port}"}
    assert status(owner_address, "GET", "/", **names) == 200
    assert websocket_status(owner_address, **names) == 101


FOREIGN = ("http://evil.example", "https://127.0.0.1:8080", "http://127.0.0.1:1", "null", None)


@pytest.mark.parametrize(
    "changed",
    [
        # A host name that an attacker lets resolve to 127.0.0.1 appears in the Host header.
        *({"host": host} for host in ("evil.example:8080", "127.0.0.1", "127.0.0.1:1", "localhost.evil.example:8080")),
        *({"origin": origin} for origin in FOREIGN),
    ],
    ids=str,
)
def test_a_request_of_another_page_is_refused(owner_address: str, changed: dict[str, Any]) -> None:
    assert websocket_status(owner_address, **changed) == 403
    path = "/upload/photograph?name=a.png"
    assert status(owner_address, "POST", path, **changed, Content_Length="0") == 403
    assert status(owner_address, "GET", "/", **changed) == (403 if "host" in changed else 200)


def test_the_socket_path_accepts_websockets_only_and_a_page_is_only_asked_for(owner_address: str) -> None:
    """Socket.IO's polling would let a GET act like a message."""
    polling = "/_nicegui_ws/socket.io/?EIO=4&transport=polling"
    assert [status(owner_address, each, polling, Content_Length="0") for each in ("GET", "POST")] == [403, 403]
    others = {status(owner_address, each, "/", Content_Length="0") for each in ("PUT", "DELETE", "PATCH", "OPTIONS")}
    assert others <= {404, 405}


@pytest.mark.parametrize(
    ("port", "host", "accepted"),
    [(80, "localhost", True), (80, "127.0.0.1:80", True), (81, "localhost", False), (81, "[::1]:81", True)],
)
def test_a_port_that_browsers_leave_out_may_be_left_out(port: int, host: str, accepted: bool) -> None:
    async def ask() -> int:
        transport = httpx.ASGITransport(AccessCheck(PlainTextResponse(""), port, "token"))
        headers = {"host": host, "cookie": f"skymosaic_{port}=token"}
        async with httpx.AsyncClient(transport=transport, base_url="http://panel", headers=headers) as browser:
            return (await browser.get("/")).status_code

    assert asyncio.run(ask()) == (200 if accepted else 403)


@pytest.fixture
def owners(owner_address: str) -> Iterator[list[httpx.Client]]:
    with enter(owner_address) as one, enter(owner_address) as other:
        yield [one, other]


def test_all_browsers_of_the_owner_show_the_same(owners: list[httpx.Client]) -> None:
    one, other = owners
    before = set(PICTURE.findall(other.get("/").text))
    assert upload(one, "field.png", noise_png()).status_code == 204
    (shown,) = set(PICTURE.findall(other.get("/").text)) - before
    assert other.get(shown).content == one.get(shown).content != b""


@pytest.mark.parametrize("token", [None, "", "x", "{token}x", "ü"])
def test_without_the_token_nothing_is_shown_and_nothing_stored(
    owners: list[httpx.Client], panel: str, owner_address: str, token: str | None
) -> None:
    """As it is by a bookmark without the token, a guess, or with the cookie of a panel that has ended."""
    owner = owners[0]
    assert upload(owner, "field.png", noise_png()).status_code == 204
    shown = PICTURE.findall(owner.get("/").text)
    given = None if token is None else token.format(token=owner_address.partition("=")[2]).encode()
    cookie = b"" if given is None else f"skymosaic_{urlsplit(panel).port}=".encode() + given
    headers = {b"origin": panel.encode(), b"cookie": cookie}
    with httpx.Client(base_url=panel, headers=headers, timeout=None) as stranger:
        assert upload(stranger, "field.png", noise_png()).status_code == 403
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
