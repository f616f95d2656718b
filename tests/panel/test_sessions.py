"""What a visitor has: one job at a time, limits, and no file that nothing shows."""

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator
from pathlib import Path

import cv2
import nicegui.core
import numpy as np
import pytest

from skymosaic.panel import sessions
from skymosaic.panel.sessions import Visitor, Visitors
from skymosaic.panel.uploads import UploadRefusedError

Story = Callable[[], Awaitable[None]]

pytestmark = pytest.mark.usefixtures("workers")


@pytest.fixture
def everyone() -> Iterator[Visitors]:
    those = Visitors()
    yield those
    those.close()


@pytest.fixture
def live(monkeypatch: pytest.MonkeyPatch) -> Callable[[Story], None]:
    """Runs a story in the event loop that background tasks are given to."""

    def run(story: Story) -> None:
        async def told() -> None:
            monkeypatch.setattr(nicegui.core, "loop", asyncio.get_running_loop())
            await asyncio.wait_for(story(), timeout=120)

        asyncio.run(told())

    return run


async def body(data: bytes) -> AsyncIterator[bytes]:
    yield data


def picture(seed: int) -> bytes:
    noise = np.random.default_rng(seed).integers(0, 256, (96, 96), np.uint8)
    return cv2.imencode(".png", noise)[1].tobytes()


async def idle(visitor: Visitor) -> None:
    while visitor.job is not None:
        await asyncio.sleep(0.02)


def files(visitor: Visitor, folder: str) -> set[str]:
    return {path.name for path in visitor._folder(folder).rglob("*") if path.is_file()}


def test_what_was_replaced_leaves_no_file(everyone: Visitors, live: Callable[[Story], None]) -> None:
    visitor = everyone.of("one")

    async def story() -> None:
        for seed in (1, 2):
            await visitor.upload("template", body(picture(seed)), "car.png")
        await visitor.upload("photograph", body(picture(3)), "field.png")
        assert files(visitor, "uploads") == {"02_car.png", "03_field.png"}
        assert files(visitor, "views") == {"02_car.png.png", "03_field.png.png"}
        visitor.load_built_in(2)
        await idle(visitor)
        first = {"02_car.png", *(upload.name for upload in visitor.photographs)}
        assert len(first) == 3
        assert files(visitor, "uploads") == first
        visitor.make_mosaic()
        await idle(visitor)
        views = files(visitor, "views")
        visitor.keep_photographs(())
        assert files(visitor, "uploads") == {"02_car.png"}
        assert files(visitor, "views") == views, "the mosaic still shows them"

    live(story)


def test_nothing_starts_while_a_job_runs(everyone: Visitors, live: Callable[[Story], None]) -> None:
    visitor = everyone.of("one")

    async def story() -> None:
        visitor.load_built_in(2)
        await idle(visitor)
        visitor.make_mosaic()
        running, (run,) = visitor.job, visitor._folder("runs").iterdir()
        visitor.make_mosaic()
        visitor.load_built_in(9)
        visitor.load_built_in_film()
        assert visitor.job is running
        assert list(visitor._folder("runs").iterdir()) == [run]
        await idle(visitor)
        assert visitor.fault == ""
        assert visitor.outcome.folder == run

    live(story)


def test_runs_without_an_outcome_are_removed_with_the_next(everyone: Visitors, live: Callable[[Story], None]) -> None:
    visitor = everyone.of("one")

    async def story() -> None:
        visitor.load_built_in(2)
        await idle(visitor)
        for _ in range(3):
            visitor.make_mosaic()
            visitor.cancel()
            await idle(visitor)
            assert visitor.fault == "Making the mosaic: cancelled"
        assert len(list(visitor._folder("runs").iterdir())) == 1

    live(story)


@pytest.mark.parametrize(("limit", "says"), [("MOST_BYTES", "larger than the 0 MB"), ("MOST_PHOTOGRAPHS", "no more")])
def test_room_ends(
    everyone: Visitors, live: Callable[[Story], None], monkeypatch: pytest.MonkeyPatch, limit: str, says: str
) -> None:
    visitor = everyone.of("one")
    monkeypatch.setattr(sessions, limit, 1)

    async def story() -> None:
        refusals = []
        for seed in (1, 2):
            try:
                await visitor.upload("photograph", body(picture(seed)), "field.png")
            except UploadRefusedError as error:
                refusals.append(error)
        assert refusals
        assert all(error.status == 413 and says in str(error) for error in refusals)

    live(story)
    assert len(files(visitor, "uploads")) == len(visitor.photographs) <= 1


def test_those_who_came_first_make_room(
    everyone: Visitors, live: Callable[[Story], None], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sessions, "MOST_KEPT", 2)
    those = [everyone.of(number) for number in ("one", "two", "three")]

    async def story() -> None:
        for seed, visitor in enumerate(those[:2]):
            await visitor.upload("photograph", body(picture(seed)), "field.png")
        those[0].load_built_in(2)
        seen = []
        those[1].changed.subscribe(lambda: seen.append(list(those[1].photographs)))
        await those[2].upload("photograph", body(picture(3)), "field.png")
        assert [len(visitor.photographs) for visitor in those] == [1, 0, 1], "the first one's work was running"
        assert seen == [[]]
        await idle(those[0])
        assert len(those[0].photographs) == 2

    live(story)


def test_a_number_is_one_visitor(everyone: Visitors) -> None:
    one = everyone.of("one")
    assert everyone.of("one") is one
    assert everyone.of("two") is not one


def test_nothing_stays_behind(live: Callable[[Story], None], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    those = Visitors()
    visitor = those.of("one")

    async def story() -> None:
        await visitor.upload("photograph", body(picture(1)), "field.png")
        assert any(tmp_path.rglob("*.png"))
        those.close()

    live(story)
    assert not any(tmp_path.rglob("*.png"))
