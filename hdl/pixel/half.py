"""The half-size level of the pyramid."""

from amaranth import Const, Module, Signal, Value
from amaranth.lib import data
from amaranth.lib.wiring import In, Out

from hdl.lib.component import Component
from hdl.lib.delay import delayed
from hdl.lib.line_memory import LineMemory
from hdl.streams import beat


class Half(Component):
    """Mean of each 2x2 block, ``(a + b + c + d + 2) >> 2``, as soon as the block's last pixel has arrived.

    An odd last row or column is dropped.

    Parameters
    ----------
    width_px : int
        Largest width of the full-size line.
    pixels_per_clock : {1, 2}
        Pixels of a beat at full size. The two pixels of a beat must both be pixels of the line.
    """

    i: data.View
    """Beats of ``pixel`` at full size."""
    o: Out(beat(pixel=8))
    """Beats of one ``pixel`` at half size, with the half-size scan position."""

    latency_cycles = LineMemory.latency_cycles + 1
    """From the block's last pixel to its mean."""

    def __init__(self, *, width_px: int, pixels_per_clock: int = 1) -> None:
        self.width_px = width_px
        self.pixels_per_clock = pixels_per_clock
        super().__init__(i=In(beat(pixels_per_clock, pixel=8)))

    def elaborate(self, platform: object) -> Module:
        """Store the pair sums of even lines; add them to those of odd lines."""
        m = Module()
        m.submodules.memory = pairs_above = LineMemory(shape=9, depth=self.width_px // 2)
        pair = Signal(9, reset_less=True)
        ends_pair: Value = self.i.x[0]
        with m.If(self.i.valid):
            if self.pixels_per_clock == 2:
                # A beat starts at an even x: it is a pair.
                m.d.sync += pair.eq(self.i.pixel[0] + self.i.pixel[1])
                ends_pair = Const(1)
            else:
                left = Signal(8, reset_less=True)
                m.d.sync += [left.eq(self.i.pixel), pair.eq(left + self.i.pixel)]
        m.d.comb += [pairs_above.i_read_address.eq(self.i.x >> 1), pairs_above.i_read.eq(self.i.valid)]

        column = delayed(m, self.i.x, 1)
        row = delayed(m, self.i.y, 1)
        paired = delayed(m, self.i.valid & ends_pair, 1, reset_less=False)
        # Written only in even lines, while the data that is read counts only in odd ones: no conflict at one address.
        m.d.comb += [
            pairs_above.i_write_address.eq(column >> 1),
            pairs_above.i_word.eq(pair),
            pairs_above.i_write.eq(paired & ~row[0]),
        ]

        below = delayed(m, pair, pairs_above.latency_cycles - 1)
        pixel = Signal(8, reset_less=True)
        m.d.sync += pixel.eq((pairs_above.o_word + below + 2) >> 2)
        m.d.comb += [
            self.o.valid.eq(delayed(m, paired & row[0], 2, reset_less=False)),
            self.o.x.eq(delayed(m, column >> 1, 2)),
            self.o.y.eq(delayed(m, row >> 1, 2)),
            self.o.pixel.eq(pixel),
        ]
        return m
