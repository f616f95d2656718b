from collections.abc import Callable

import pytest
from nicegui import Client
from nicegui.page import page

from skymosaic.panel.widgets.slider import Slider
from tests.skymosaic.panel.visitor import Scenario


def test_the_thumb_is_moved_only_where_it_is_not_yet(
    run_in_loop: Callable[[Scenario], None], monkeypatch: pytest.MonkeyPatch
) -> None:
    moved: list[object] = []
    monkeypatch.setattr(Slider, "run_method", lambda _slider, *call: moved.append(call))

    async def scenario() -> None:
        with Client(page("/slider"), request=None):
            slider = Slider(lambda _position: None)
        for position in (3, 3, 5, 4, 4):
            slider.show(lowest=0, highest=9, position=position, label="Threshold", words=f"{position} px")
        assert moved == [("moveTo", 5), ("moveTo", 4)]
        assert slider.props == {"start": 3, "min": 0, "max": 9, "label": "Threshold", "words": "4 px"}

    run_in_loop(scenario)
