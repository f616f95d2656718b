"""The corners that follow the slider equal those of a run."""

import asyncio
import re
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest

from sim.scene import make_pair
from skymosaic.features.backends import load_backend
from skymosaic.panel.options import Options
from skymosaic.panel.pages.corners_tab import CornersTab, detect
from skymosaic.panel.pages.drawings import draw_corners


@pytest.fixture(scope="module")
def picture(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("pictures") / "field.png"
    cv2.imwrite(str(path), make_pair(seed=9, size=(400, 300)).images[0])
    return path


@pytest.mark.parametrize("detector", ["harris", "fast"])
def test_the_slider_shows_the_corners_of_a_run(picture: Path, detector: str) -> None:
    pixels, counts = np.asarray(cv2.imread(str(picture))), set()
    for position in {"harris": (19, 30, 38), "fast": (2, 20, 34)}[detector]:
        options = Options.of_preset("aerial").changed("detector", detector).changed("position", position)
        (shown,) = detect([picture], options)
        (found,) = load_backend("golden").run([pixels], options.choose_method()[1])
        assert np.array_equal(shown, found.features)
        counts.add(len(shown))
    assert len(counts) == 3


def test_without_cell_selection_the_threshold_rises_until_all_corners_fit(picture: Path) -> None:
    lowest = Options.of_preset("thesis").changed("position", 19)
    (shown,) = detect([picture], lowest)
    assert 0 < len(shown) <= lowest.choose_method()[1].front_end.max_features


def test_a_session_that_is_closed_ends_the_detection_of_its_corners(tmp_path: Path) -> None:
    tab: Any = CornersTab.__new__(CornersTab)
    tab._session = SimpleNamespace(options=Options.of_preset("aerial"))
    tab._photographs, tab._drawn = (SimpleNamespace(working=tmp_path / "gone.png"),), ()
    asyncio.run(tab._detect_and_draw())
    assert not tab._detecting
    assert not tab._drawn


@pytest.mark.parametrize(("descriptor", "drawn"), [("ilbp-128", 1), ("akaze", 0)])
def test_corners_are_drawn_until_they_fit_the_options(picture: Path, descriptor: str, drawn: int) -> None:
    """Options that cannot be combined change nothing."""
    said: list[str] = []
    tab: Any = CornersTab.__new__(CornersTab)
    tab._session = SimpleNamespace(options=Options.of_preset("aerial").changed("descriptor", descriptor))
    photograph: Any = SimpleNamespace(working=picture, working_size=(400, 300))
    tab._photographs, tab._drawn = (photograph, photograph), ()
    tab._viewer = SimpleNamespace(draw=said.append)
    tab._counts = SimpleNamespace(set_text=said.append)
    asyncio.run(tab._detect_and_draw())
    assert not tab._detecting
    assert len(said) == 2 * drawn
    if drawn:
        corners = detect([picture, picture], tab._session.options)
        assert said[0] == "".join(draw_corners(found, x) for found, x in zip(corners, (0, 412), strict=True))
        assert re.fullmatch(rf"{len(corners[0])} and {len(corners[0])} corners, detected in [1-9]\d* ms", said[1])
        assert tab._drawn == tab._inputs()
