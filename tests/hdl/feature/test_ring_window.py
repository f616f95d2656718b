"""The ring pixels equal the golden model's."""

import numpy as np
import pytest
from amaranth import Module
from amaranth.lib import data, wiring
from amaranth.lib.wiring import In, Out

from golden_model.feature.ilbp import PATTERNS, DescriptorPattern, gather
from hdl.feature.ring_window import RingWindow
from hdl.streams import beat, carry_scan
from sim.benches.drivers import run_beats
from sim.simulators.recording import Pauses


class RingBeats(wiring.Component):
    """A ring window that sends its pixels as beats; of two pixels, those of the chosen one in place of both."""

    def __init__(self, *, pattern: DescriptorPattern, width_px: int, pixels_per_clock: int, second: bool) -> None:
        self.pixels_per_clock, self.second = pixels_per_clock, second
        self.window = RingWindow(pattern=pattern, width_px=width_px, pixels_per_clock=pixels_per_clock)
        rings = data.ArrayLayout(8, len(pattern.radii_px) * pattern.angles)
        super().__init__({"i": In(self.window.i.shape()), "o": Out(beat(pixels=rings))})

    def elaborate(self, platform: object) -> Module:
        m = Module()
        m.submodules.window = self.window
        m.d.comb += self.window.i.eq(self.i)
        if self.pixels_per_clock == 2:
            m.d.comb += self.window.i_second.eq(self.second)
        carry_scan(m, self.i, self.o, self.window.latency_cycles)
        pixels = [pixel for ring in self.window.o_pixels for pixel in ring]
        m.d.comb += [o_pixel.eq(pixel) for o_pixel, pixel in zip(self.o.pixels, pixels, strict=True)]
        return m


@pytest.mark.parametrize(
    ("name", "shape", "pixels_per_clock", "second", "gaps"),
    [
        ("thesis-ilbp-3", (17, 23), 1, False, 80),
        ("thesis-ilbp-3", (17, 23), 2, False, 0),
        ("thesis-ilbp-3", (17, 23), 2, True, 80),
    ],
)
def test_ring_window_gives_the_pixels_of_the_rings(
    name: str, shape: tuple[int, int], pixels_per_clock: int, second: bool, gaps: int
) -> None:
    height_px, width_px = shape
    pattern = PATTERNS[name]
    frames = np.random.default_rng(5).integers(0, 256, (2, *shape), dtype=np.uint8)
    dut = RingBeats(pattern=pattern, width_px=width_px, pixels_per_clock=pixels_per_clock, second=second)
    lag_px = dut.window.lag_px
    assert lag_px == max(pattern.radii_px)
    pauses = Pauses(gaps=gaps, seed=2)
    sent, received = run_beats(dut, [{"pixel": frame} for frame in frames], pauses=pauses, received_per_clock=1)
    np.testing.assert_array_equal(received.cycles - sent.cycles[::pixels_per_clock], dut.window.latency_cycles)
    received.fields["x"] += second
    inside = np.mgrid[lag_px : height_px - lag_px, lag_px : width_px - lag_px]
    y, x = inside[..., second::pixels_per_clock].reshape(2, -1)
    offsets = [offset for ring in pattern.offsets for offset in ring]
    for frame, part in zip(frames, received.split(), strict=True):
        planes = part.plane("pixels", frame.shape, lag_px=lag_px)
        np.testing.assert_array_equal(planes[y, x].T, gather(frame, x, y, offsets))
