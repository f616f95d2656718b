"""Every browser has a session of its own; they leave nothing behind."""

from collections.abc import Callable
from pathlib import Path

import pytest

from skymosaic.panel.sessions import Sessions
from tests.skymosaic.panel.visitor import Scenario, body, noise_png

pytestmark = pytest.mark.usefixtures("workers")


def test_an_identifier_is_one_session(sessions: Sessions) -> None:
    one = sessions.get("one")
    assert sessions.get("one") is one
    assert sessions.get("two") is not one


def test_closing_removes_every_file(
    run_in_loop: Callable[[Scenario], None], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    sessions = Sessions()
    session = sessions.get("one")

    async def scenario() -> None:
        await session.upload("photograph", body(noise_png(96, 1)), "field.png")
        assert any(tmp_path.rglob("*.png"))
        sessions.close()

    run_in_loop(scenario)
    assert not any(tmp_path.rglob("*.png"))
