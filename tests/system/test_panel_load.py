"""A busy panel: many browsers at once, aborted uploads, and what is left when it ends."""

import os
import re
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from urllib.parse import urlsplit

import httpx
import pytest

from tests.skymosaic.panel.visitor import enter, noise_png, upload

BROWSERS = 10
UPLOADS = 10


@pytest.fixture
def temp() -> Iterator[Path]:
    """The panel's temporary files; a short path, because the workers' sockets below it take 107 characters at most."""
    with tempfile.TemporaryDirectory(prefix="panel") as folder:
        yield Path(folder)


@pytest.fixture
def panel(tmp_path: Path, temp: Path) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """A panel whose temporary files are below ``temp``; yields its process and its address, with the token."""
    environment = {**os.environ, "TMPDIR": str(temp), "PYTHONPATH": str(Path(__file__).parents[2])}
    words = [sys.executable, "-u", "-m", "skymosaic", "panel", "--port", "0", "--runs", str(temp)]
    log = tmp_path / "log"
    with log.open("w") as output:
        process = subprocess.Popen(words, stdout=subprocess.PIPE, stderr=output, text=True, env=environment)
    with process:
        try:
            address = re.search(r"http://127\.0\.0\.1:\d+/\?token=\S+", process.stdout.readline())
            assert address, log.read_text()
            yield process, address.group()
        finally:
            process.kill()


def upload_many(address: str) -> list[int]:
    with enter(address) as client:
        return [upload(client, f"a_{index}.png", noise_png()).status_code for index in range(UPLOADS)]


def abort(address: str, cookie: str) -> None:
    """Announce a long upload, send its beginning and hang up."""
    place = urlsplit(address)
    lines = [
        "POST /upload/photograph?name=b.png HTTP/1.1", f"Host: {place.netloc}", f"Origin: http://{place.netloc}",
        f"Cookie: {cookie}", "Content-Length: 1000000", "", "",
    ]  # fmt: skip
    with socket.create_connection((place.hostname, place.port)) as connection:
        connection.sendall("\r\n".join(lines).encode() + b"\x89PNG\r\n\x1a\n" + bytes(1000))
        time.sleep(0.2)


@pytest.mark.slow
def test_many_browsers_are_served_and_nothing_is_left(
    panel: tuple[subprocess.Popen[str], str], tmp_path: Path, temp: Path
) -> None:
    process, address = panel
    with ThreadPoolExecutor(BROWSERS) as pool:
        statuses = [status for each in pool.map(upload_many, [address] * BROWSERS) for status in each]
    assert statuses == [204] * (BROWSERS * UPLOADS)
    with enter(address) as client:
        pictures = set(re.findall(r"/picture/uploads/[\w.]+", client.get("/").text))
        assert [client.get(picture).status_code for picture in pictures] == [200] * (BROWSERS * UPLOADS)
        for _ in range(5):
            abort(address, "; ".join(f"{name}={value}" for name, value in client.cookies.items()))
        assert client.get("/").status_code == 200
        refused = client.post("/upload/photograph", params={"name": "a.png"}, content=b"x", headers={"origin": "null"})
        assert refused.status_code == 403
        assert "frame-ancestors 'none'" in refused.headers["content-security-policy"]
    process.send_signal(signal.SIGTERM)
    process.wait()
    assert "Traceback" not in (tmp_path / "log").read_text()
    assert [path.name for path in temp.iterdir()] == []


def test_a_closed_terminal_ends_it_in_order(
    panel: tuple[subprocess.Popen[str], str], tmp_path: Path, temp: Path
) -> None:
    process, address = panel
    assert httpx.get(address, follow_redirects=False).status_code == 303
    process.send_signal(signal.SIGHUP)
    process.wait()
    assert (tmp_path / "log").read_text() == ""
    assert [path.name for path in temp.iterdir()] == []
