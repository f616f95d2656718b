"""The half-size level equals the golden model."""

import numpy as np
import pytest
from numpy.typing import NDArray

from golden_model.pixel import half
from hdl.pixel.half import Half
from sim.benches.drivers import run_beats
from sim.simulators.recording import Pauses

WIDTH_PX = 16


@pytest.mark.parametrize("shape", [(9, 13), (8, 16), (4, 4)])
def test_half_equals_the_golden_model(
    gray_frames: list[NDArray[np.uint8]], pauses: Pauses, shape: tuple[int, int], rate: dict[str, int]
) -> None:
    dut = Half(width_px=WIDTH_PX, **rate)
    # Two pixels of a beat must both be in the line.
    frames = [
        np.resize(frame, (shape[0], shape[1] // dut.pixels_per_clock * dut.pixels_per_clock)) for frame in gray_frames
    ]
    sent, received = run_beats(dut, [{"pixel": frame} for frame in frames], pauses=pauses, received_per_clock=1)
    ends_block = (sent.fields["x"] % 2 == 1) & (sent.fields["y"] % 2 == 1)
    np.testing.assert_array_equal(received.cycles - sent.cycles[ends_block], dut.latency_cycles)
    for part, frame in zip(received.split(), frames, strict=True):
        expected = half.halve(frame)
        np.testing.assert_array_equal(part.plane("pixel", expected.shape), expected)
