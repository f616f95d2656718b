"""Every browser has a session of its own; sessions make room for each other, and leave nothing behind."""

from collections.abc import Callable
from pathlib import Path

import pytest

from skymosaic.panel import sessions as sessions_module
from skymosaic.panel.sessions import Sessions
from tests.skymosaic.panel.visitor import Scenario, body, idle, noise_png

pytestmark = pytest.mark.usefixtures("workers")


def test_the_oldest_idle_session_makes_room(
    sessions: Sessions, run_in_loop: Callable[[Scenario], None], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sessions_module, "MAX_SESSIONS", 2)
    three = [sessions.get(number) for number in ("one", "two", "three")]

    async def scenario() -> None:
        for seed, session in enumerate(three[:2]):
            await session.upload("photograph", body(noise_png(96, seed)), "field.png")
        three[0].make_mosaic()
        shown = []
        three[1].changed.subscribe(lambda: shown.append(list(three[1].photographs)))
        await three[2].upload("photograph", body(noise_png(96, 3)), "field.png")
        assert [len(session.photographs) for session in three] == [1, 0, 1], "the first one's job was running"
        assert shown == [[]]
        await idle(three[0])
        assert len(three[0].photographs) == 1

    run_in_loop(scenario)


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
