from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import pytest
from amaranth.lib import wiring
from numpy.typing import NDArray

from sim.benches.drivers import Beats, run_beats
from sim.simulators.recording import Pauses

SHAPE = (19, 23)


@pytest.fixture(params=[0, 100], ids=["back_to_back", "gaps"])
def pauses(request: pytest.FixtureRequest) -> Pauses:
    return Pauses(gaps=request.param, seed=7)


@pytest.fixture
def gray_frames() -> list[NDArray[np.uint8]]:
    """Frames of different content, with the extremes, at an odd size."""
    noise = np.random.default_rng(11).integers(0, 256, (2, *SHAPE), dtype=np.uint8)
    y, x = np.indices(SHAPE)
    white_and_black = np.where(x < 10, 255, 0).astype(np.uint8)
    white_and_black[9, 16] = 255
    checkerboard = ((x + y) % 2 * 255).astype(np.uint8)
    steps = np.where((x // 4 + y // 4) % 2, noise[1] // 16, 255 - noise[1] // 16).astype(np.uint8)
    return [noise[0], white_and_black, checkerboard, steps]


@pytest.fixture
def run_block(pauses: Pauses) -> Callable[..., list[Beats]]:
    """Send frames through a block that answers each beat after ``latency_cycles``; returns its answers by frame."""

    def run(
        dut: wiring.Component,
        frames: Sequence[Mapping[str, NDArray[Any]]],
        settings: Mapping[str, int] | None = None,
    ) -> list[Beats]:
        sent, received = run_beats(dut, frames, settings=settings, pauses=pauses)
        np.testing.assert_array_equal(received.cycles - sent.cycles, dut.latency_cycles)
        return received.split()

    return run


@pytest.fixture
def check_block(run_block: Callable[..., list[Beats]]) -> Callable[..., None]:
    """Compare fields of a block's answers with one plane for each frame, except in a margin of ``margin_px``."""

    def check(
        dut: wiring.Component,
        frames: Sequence[Mapping[str, NDArray[Any]]],
        expected: Mapping[str, Sequence[NDArray[Any]]],
        *,
        margin_px: int = 0,
        settings: Mapping[str, int] | None = None,
    ) -> None:
        parts = run_block(dut, frames, settings)
        for field, planes in expected.items():
            for number, (part, plane) in enumerate(zip(parts, planes, strict=True)):
                inside = tuple(slice(margin_px, side - margin_px) for side in plane.shape)
                actual = part.plane(field, plane.shape, lag_px=getattr(dut, "lag_px", 0))
                np.testing.assert_array_equal(actual[inside], plane[inside], f"{field} of frame {number}")

    return check


@pytest.fixture(params=[1, 2], ids=["one_pixel", "two_pixels"])
def rate(request: pytest.FixtureRequest) -> dict[str, int]:
    """Parameters of a block: pixels of a beat."""
    return {"pixels_per_clock": request.param}
