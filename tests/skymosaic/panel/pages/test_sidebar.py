"""What the column of the panel says of the photographs."""

from types import SimpleNamespace
from typing import Any

import pytest

from skymosaic.panel.pages.sidebar import PhotographsCard
from skymosaic.panel.widgets.thumbnails import MAX_TILES


@pytest.mark.parametrize(
    ("count", "done", "text"),
    [
        (3, None, "3 photographs"),
        (3, 1, "3 photographs, 1 read"),
        (3, 3, "3 photographs"),
        (MAX_TILES, 0, f"{MAX_TILES} photographs, 0 read"),
        (MAX_TILES + 1, None, f"{MAX_TILES + 1} photographs, the first {MAX_TILES} are shown"),
    ],
)
def test_photographs_are_counted_while_they_are_read(count: int, done: int | None, text: str) -> None:
    reading = None if done is None else SimpleNamespace(steps=SimpleNamespace(done=done))
    said: list[Any] = []
    card: Any = SimpleNamespace(
        _session=SimpleNamespace(inputs=SimpleNamespace(photographs=[None] * count, reading=reading)),
        _count=SimpleNamespace(set_text=said.append),
        _tiles=SimpleNamespace(show=said.append),
    )
    card._read = lambda: PhotographsCard._read(card)
    PhotographsCard._tick(card)
    assert said == [text, *([] if done is None else [done])]
