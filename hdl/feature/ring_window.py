"""The ring pixels of a descriptor around every pixel."""

from collections.abc import Sequence

from amaranth import Cat, Module, Mux, Signal, Value
from amaranth.lib import data
from amaranth.lib.wiring import In, Out

from golden_model.feature.ilbp import DescriptorPattern
from hdl.lib.component import Component
from hdl.lib.delay import WORD_BITS
from hdl.lib.views import view_signal
from hdl.pixel.window import LineBuffer
from hdl.streams import beat, each_pixel

LINES_PER_REGISTER = WORD_BITS // 8


class RingWindow(Component):
    """Ring pixels around the pixel ``lag_px`` left of and above the scan position.

    One memory holds ``2 * lag_px`` lines. Each line with ring pixels feeds a chain of places, as long as its leftmost
    ring pixel requires; stretches without a tap pack into shift-register LUTs. Within ``lag_px`` of the frame's border
    the pixels are unspecified. Nothing needs a reset.

    Parameters
    ----------
    pattern : DescriptorPattern
    width_px : int
        Largest width of a line.
    """

    i: data.View
    """Beats of ``pixel``."""
    i_second: Signal
    """With two pixels per beat: ``o_pixels`` of the same clock are those of the right one."""
    o_pixels: Sequence[Sequence[Signal]]
    """Pixels by ring and angle, in the order of `DescriptorPattern.offsets`, valid ``latency_cycles``
    after the beat, until those of the next beat. There is one signal per pixel: a single wide signal made compiled
    simulations a third slower (measured)."""

    lag_px: int
    """The largest radius."""

    def __init__(self, *, pattern: DescriptorPattern, width_px: int, pixels_per_clock: int = 1) -> None:
        self.pattern = pattern
        self.pixels_per_clock = pixels_per_clock
        self.lag_px = max(pattern.radii_px)
        self._lines = LineBuffer(shape=8, lines=2 * self.lag_px, width_px=width_px, pixels_per_clock=pixels_per_clock)
        self.latency_cycles = self._lines.latency_cycles + 1
        super().__init__(
            i=In(beat(pixels_per_clock, pixel=8)),
            **({"i_second": In(1)} if pixels_per_clock == 2 else {}),
            o_pixels=Out(8).array(len(pattern.radii_px), pattern.angles),
        )

    def elaborate(self, platform: object) -> Module:
        """The column at the scan position, and a chain of places per line that has ring pixels."""
        m = Module()
        m.submodules.lines = lines = self._lines
        m.d.comb += lines.i.eq(self.i)
        pixels = self._chains(m)
        for ring, o_ring in zip(self.pattern.offsets, self.o_pixels, strict=True):
            for (x, y), o_pixel in zip(ring, o_ring, strict=True):
                place = self.lag_px - x
                pixel = pixels[y, place]
                if self.pixels_per_clock == 2:
                    # The left pixel of the beat is one place older.
                    pixel = Mux(self.i_second, pixel, pixels[y, place + 1])
                m.d.comb += o_pixel.eq(pixel)
        return m

    def _chains(self, m: Module) -> dict[tuple[int, int], Value]:
        """Store the pixels by line and place: y as in the pattern's offsets, and the distance from the newest pixel.

        A register holds one place of several lines and copies the place before it, so that compiled simulations copy
        machine words. A register per line would read itself, and Verilator keeps a second copy of those.
        """
        pixels: dict[tuple[int, int], Value] = {}
        newest = list(reversed(each_pixel(self._lines.o.column, self.pixels_per_clock)))
        lengths = self._lengths()
        by_length = sorted(lengths, key=lambda y: (-lengths[y], y))
        for first in range(0, len(by_length), LINES_PER_REGISTER):
            together = by_length[first : first + LINES_PER_REGISTER]
            for place in range(lengths[together[0]]):
                present = [y for y in together if place < lengths[y]]
                name = f"lines{first}_{place}"
                register = view_signal(data.ArrayLayout(8, len(present)), name=name, reset_less=True)
                # y points down: the line that is `lag_px - y` above the scan position.
                following = [
                    newest[place][self.lag_px - y]
                    if place < self.pixels_per_clock
                    else pixels[y, place - self.pixels_per_clock]
                    for y in present
                ]
                with m.If(self._lines.o.valid):
                    m.d.sync += register.eq(Cat(following))
                pixels.update({(y, place): register[n] for n, y in enumerate(present)})
        return pixels

    def _lengths(self) -> dict[int, int]:
        """Number of places of each line that has ring pixels."""
        lengths: dict[int, int] = {}
        for x, y in (offset for ring in self.pattern.offsets for offset in ring):
            lengths[y] = max(lengths.get(y, 0), self.lag_px - x + self.pixels_per_clock)
        return lengths
