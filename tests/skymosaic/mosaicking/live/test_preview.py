"""Previews are compared with the ground that their frames show."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from golden_model.arrays import Matrix
from skymosaic.flight.linking.view import View
from skymosaic.imagery.images import Photograph
from skymosaic.imagery.live_frames import LiveFrame
from skymosaic.mosaicking.live import run
from skymosaic.mosaicking.live.preview import paint_preview
from tests.skymosaic.mosaicking.live.conftest import shift, view_of


def frame(thumbnail: NDArray[np.uint8], transform: Matrix) -> tuple[View, Matrix]:
    return replace(view_of(thumbnail), thumbnail=thumbnail, to_thumbnail=np.eye(3)), transform


@pytest.fixture(scope="module")
def ground() -> NDArray[np.uint8]:
    grain = np.random.default_rng(0).integers(60, 190, (240, 400, 3), dtype=np.uint8)
    return np.asarray(cv2.GaussianBlur(grain, (0, 0), 4), np.uint8)


def test_two_frames_of_one_ground_show_the_ground(ground: NDArray[np.uint8]) -> None:
    """Upright and turned, beside the middle of the reference frame, and gray ones too."""
    left, right = frame(ground[:, :240], shift(-30, 5)), frame(ground[:, 160:], shift(130, 5))
    np.testing.assert_array_equal(paint_preview([left, right]), ground)
    upside_down = frame(np.ascontiguousarray(ground[::-1, 160:][:, ::-1]), shift(369, 244) @ np.diag([-1.0, -1, 1]))
    np.testing.assert_allclose(paint_preview([left, upside_down]), ground, atol=1)
    np.testing.assert_array_equal(
        paint_preview([frame(ground[..., 0], np.eye(3))]), np.repeat(ground[..., :1], 3, axis=2)
    )


def test_the_farther_border_shows_whatever_the_order(ground: NDArray[np.uint8]) -> None:
    other = frame(250 - ground[:, :200], np.eye(3))
    for frames in ([frame(ground, np.eye(3)), other], [other, frame(ground, np.eye(3))]):
        where = slice(60, 180), slice(150, None)
        np.testing.assert_array_equal(paint_preview(frames)[where], ground[where])


def test_a_preview_is_limited_and_may_be_empty(ground: NDArray[np.uint8]) -> None:
    assert paint_preview([]).size == 0
    small = paint_preview([frame(ground, shift(7, 9) @ np.diag([3.0, 3, 1]))], width_px=100)
    assert small.shape[1] in (99, 100)
    np.testing.assert_allclose(small, cv2.resize(ground, small.shape[1::-1], interpolation=cv2.INTER_AREA), atol=12)


@pytest.mark.parametrize(("width_px", "shape"), [(300, (240, 50)), (120, (240, 50)), (60, (120, 25))])
def test_a_narrow_preview_is_at_most_twice_as_high_as_it_may_be_wide(
    ground: NDArray[np.uint8], width_px: int, shape: tuple[int, int]
) -> None:
    tall = np.ascontiguousarray(ground[:, :50])
    assert paint_preview([frame(tall, np.eye(3))], width_px).shape[:2] == shape


@pytest.mark.parametrize(("preview_s", "least_s", "most_s"), [(0.0625, 1.0, 1.5), (0.5, 5.0, 5.5)])
def test_previews_take_a_tenth_of_the_time_and_come_at_most_once_a_second(
    monkeypatch: pytest.MonkeyPatch, preview_s: float, least_s: float, most_s: float
) -> None:
    """A frame that is left out changes nothing, and shows nothing."""
    now_s, begun, ended, numbers = [0.0], list[float](), list[float](), list[int]()

    def add(*_: Any, name: str, **_named: Any) -> Any:
        numbers.append(int(name))
        now_s[0] += 0.25
        return SimpleNamespace(reason="" if numbers[-1] % 2 else "blurred")

    def write_preview(*_: Any) -> None:
        begun.append(now_s[0])
        assert numbers[-1] % 2 or numbers[-1] == 98
        now_s[0] += preview_s
        ended.append(now_s[0])

    monkeypatch.setattr(run, "time", SimpleNamespace(monotonic=lambda: now_s[0]))
    monkeypatch.setattr(run, "_write_preview", write_preview)
    growing: Any = SimpleNamespace(add=add, transforms=[0])
    picture = Photograph("", np.zeros((64, 64), np.uint8))
    run.grow(growing, (LiveFrame(str(number), picture) for number in range(99)), Path("p.jpg"), print)
    # The last one shows all.
    pauses_s = np.subtract(begun[1:-1], ended[:-2])
    assert numbers[-1] == 98
    assert len(pauses_s) > 3
    assert least_s <= pauses_s.min()
    assert pauses_s.max() <= most_s
