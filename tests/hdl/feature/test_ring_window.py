"""The ring pixels equal the golden model's."""

from functools import partial

import numpy as np
from amaranth import Module
from amaranth.lib import data, wiring
from amaranth.lib.wiring import In, Out

from golden_model.feature.ilbp import PATTERNS, DescriptorPattern, gather
from hdl.blocks.vectors import Block, pixel_rows, rows
from hdl.feature.ring_window import RingWindow
from hdl.streams import beat, carry_scan
from sim.benches.rows import Row, check
from tests.hdl.rows import table


class RingBeats(wiring.Component):
    """A ring window that sends its pixels as beats; of two pixels, those of the chosen one in place of both."""

    def __init__(self, *, pattern: DescriptorPattern, width_px: int, pixels_per_clock: int, second: bool) -> None:
        self.pixels_per_clock, self.second = pixels_per_clock, second
        self.window = RingWindow(pattern=pattern, width_px=width_px, pixels_per_clock=pixels_per_clock)
        self.latency_cycles = self.window.latency_cycles
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


def rings(pixels_per_clock: int, second: bool) -> Block:
    pattern, (height_px, width_px) = PATTERNS["thesis-ilbp-3"], (17, 23)
    dut = RingBeats(pattern=pattern, width_px=width_px, pixels_per_clock=pixels_per_clock, second=second)
    lag_px = dut.window.lag_px
    assert lag_px == max(pattern.radii_px)
    frames = np.random.default_rng(5).integers(0, 256, (2, height_px, width_px), dtype=np.uint8)
    inside = np.mgrid[lag_px : height_px - lag_px, lag_px : width_px - lag_px]
    y, x = inside[..., second::pixels_per_clock].reshape(2, -1)
    offsets = [offset for ring in pattern.offsets for offset in ring]
    answers = []
    for frame in frames:
        found = dict(zip(zip(x, y, strict=True), gather(frame, x, y, offsets).T.tolist(), strict=True))
        for beat_y, beat_x in np.ndindex(height_px, -(-width_px // pixels_per_clock)):
            at = beat_x * pixels_per_clock
            ring = found.get((at + second - lag_px, beat_y - lag_px))
            answers.append({"x": at, "y": beat_y, **({"pixels": ring} if ring else {})})
    sent = [row for frame in frames for row in pixel_rows(pixels_per_clock, pixel=frame)]
    return Block(dut, "", {"i": sent}, {"o": rows("o", answers)})


@table(
    one=partial(rings, 1, False), the_first_of_two=partial(rings, 2, False), the_second_of_two=partial(rings, 2, True)
)
def test_ring_window_gives_the_pixels_of_the_rings(row: Row) -> None:
    check(row)
