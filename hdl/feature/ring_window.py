"""The ring pixels of a descriptor around every pixel."""

from __future__ import annotations

from collections.abc import Sequence

from amaranth import Cat, Module, Mux, Signal
from amaranth.lib import data, wiring
from amaranth.lib.wiring import In, Out

from golden_model.feature.ilbp import DescriptorPattern
from hdl.pixel.window import LineBuffer
from hdl.streams import beat, each_pixel


class RingWindow(wiring.Component):
    """Ring pixels around the pixel ``lag_px`` left of and above the scan position.

    One memory holds ``2 * lag_px`` lines. Each line with ring pixels feeds a chain of registers, as long as its
    leftmost ring pixel requires; stretches without a tap pack into shift-register LUTs. Within ``lag_px`` of the
    frame's border the pixels are unspecified. Nothing needs a reset.

    Parameters
    ----------
    pattern : DescriptorPattern
    width_px : int
        Largest width of a line.
    pixels_per_clock : {1, 2}
        Pixels of a beat.

    Members
    -------
    i : In(beat(pixel))
    i_second : In(1)
        Only with two pixels a beat: give the ring pixels of the right one. With ``o_pixels``.
    o_pixels : Out(8).array(rings, angles)
        In the order of `DescriptorPattern.offsets`, valid ``latency_cycles`` after the beat, until those of the next
        beat. There is one signal per pixel: a single wide signal made compiled simulations a third slower (measured).

    Attributes
    ----------
    latency_cycles : int
    lag_px : int
        The largest radius.
    """

    i: data.View
    i_second: Signal
    o_pixels: Sequence[Sequence[Signal]]

    def __init__(self, *, pattern: DescriptorPattern, width_px: int, pixels_per_clock: int = 1) -> None:
        self.pattern = pattern
        self.pixels_per_clock = pixels_per_clock
        self.lag_px = max(pattern.radii_px)
        self._lines = LineBuffer(shape=8, lines=2 * self.lag_px, width_px=width_px, pixels_per_clock=pixels_per_clock)
        self.latency_cycles = self._lines.latency_cycles + 1
        super().__init__(
            {
                "i": In(beat(pixels_per_clock, pixel=8)),
                **({"i_second": In(1)} if pixels_per_clock == 2 else {}),
                "o_pixels": Out(8).array(len(pattern.radii_px), pattern.angles),
            }
        )

    def elaborate(self, platform: object) -> Module:
        """The column at the scan position, and a chain of registers for each line that has ring pixels."""
        m = Module()
        m.submodules.lines = lines = self._lines
        m.d.comb += lines.i.eq(self.i)
        offsets = {offset for ring in self.pattern.offsets for offset in ring}
        chains = {}
        # y points down: the line that is `lag_px - y` above the scan position.
        for y in sorted({y for _, y in offsets}):
            above = self.lag_px - y
            length = self.lag_px - min(x for x, line in offsets if line == y) + self.pixels_per_clock
            chains[y] = Signal(data.ArrayLayout(8, length), name=f"line{above}", reset_less=True)
            newest = [column[above] for column in reversed(each_pixel(lines.o.column, self.pixels_per_clock))]
            with m.If(lines.o.valid):
                m.d.sync += chains[y].eq(Cat(newest, chains[y]))
        for ring, o_ring in zip(self.pattern.offsets, self.o_pixels, strict=True):
            for (x, y), o_pixel in zip(ring, o_ring, strict=True):
                pixel = chains[y][self.lag_px - x]
                if self.pixels_per_clock == 2:
                    pixel = Mux(self.i_second, pixel, chains[y][self.lag_px - x + 1])
                m.d.comb += o_pixel.eq(pixel)
        return m
