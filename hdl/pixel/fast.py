"""FAST corners (thesis, equation II-1): the segment test 9 of 16 and its score, decided bit by bit."""

from __future__ import annotations

from amaranth import Cat, Const, Module, Mux, Signal, Value
from amaranth.lib import data, wiring
from amaranth.lib.wiring import In, Out

from golden_model.formats import PIXEL, RESPONSE_CODE
from golden_model.pixel.fast import CIRCLE, MARGIN_PX
from hdl.lib.delay import Pipe, delayed
from hdl.pixel.window import Window
from hdl.streams import beat, carry_scan

WINDOW_PX = 2 * MARGIN_PX + 1
_EVENS_THEN_ODDS = (*CIRCLE[0::2], *CIRCLE[1::2])
"""The order of the circle's pixels in a word: all arcs are then a few rotations of its halves."""


class Fast(wiring.Component):
    """The largest threshold at which a pixel passes the segment test.

    It follows from one of the circle's pixels: of each arc of nine take the darkest pixel, and of these the brightest.
    That one is *decisive* where the arc is brighter than the centre; where it is darker, all is complemented first.
    It cannot be both, since two arcs of nine overlap; so a first test, of which pixels are brighter than the centre,
    tells which.

    The decisive pixel's bits come one after another, the highest first, and each is the answer to the same question:
    are there nine contiguous ones? A pixel whose bit differs from the answer is larger or smaller for good; from then
    on it counts as ones or as zeros only.

    Members
    -------
    i : In(beat(column))
        7 gray pixels, the newest line first.
    i_threshold_code : In(15)
        Smallest score that survives, in gray levels. Static within a frame.
    o : Out(beat(code))
        `golden_model.pixel.fast.response_code`.

    Attributes
    ----------
    lag_px : int
    latency_cycles : int
    """

    i: data.View
    i_threshold_code: Signal
    o: data.View

    lag_px = MARGIN_PX
    # The window; which pixels are brighter; arcs of these; the complement; two for each bit; difference; threshold.
    latency_cycles = Window.latency_cycles + 3 + 2 * PIXEL.bits + 2

    def __init__(self) -> None:
        column = data.ArrayLayout(PIXEL.bits, WINDOW_PX)
        self._window = Window(shape=column, columns=WINDOW_PX)
        super().__init__(
            {
                "i": In(beat(column=column)),
                "i_threshold_code": In(RESPONSE_CODE.bits),
                "o": Out(beat(code=PIXEL.bits)),
            }
        )

    def elaborate(self, platform: object) -> Module:
        """The circle around the centre, its decisive pixel, how far that is from the centre, the threshold."""
        m = Module()
        m.submodules.window = window = self._window
        m.d.comb += window.i.eq(self.i)
        carry_scan(m, window.o, self.o, self.latency_cycles - window.latency_cycles)
        columns = window.o.columns
        centre, *circle = (columns[MARGIN_PX - x][MARGIN_PX - y] for x, y in ((0, 0), *_EVENS_THEN_ODDS))

        pipe = Pipe(m, window.o.valid)
        decisive, darker, cycles = self._decisive(m, pipe, circle, centre)
        reference = delayed(m, pipe.registered(centre, 0), cycles - 1) ^ darker.replicate(PIXEL.bits)
        # Decisive - reference - 1, and a carry where it is not negative.
        difference = decisive + ~reference
        score = pipe.registered(Mux(difference[-1], difference[: PIXEL.bits], 0), cycles)
        code = Mux(score < self.i_threshold_code, 0, score)
        m.d.comb += self.o.code.eq(pipe.registered(code, cycles + 1))
        return m

    @staticmethod
    def _decisive(m: Module, pipe: Pipe, circle: list[Value], centre: Value) -> tuple[Value, Value, int]:
        """The decisive pixel, complemented where its arc is darker, whether it is, and how late they are.

        ``ones`` is what each pixel counts as in the current bit, ``settled`` whether it differed in an earlier one.
        An answer takes two clocks: whether each arc is complete, and then whether any is.
        """
        # Registered, and not only delayed, everything rests with the detector.
        planes = [pipe.registered(Cat(pixel[bit] for pixel in circle), 0) for bit in reversed(range(PIXEL.bits))]
        brighter = pipe.registered(Cat(pixel > centre for pixel in circle), 0)
        darker = ~pipe.registered(_arcs(brighter), 1).any()
        ones, *planes = (
            pipe.registered(pipe.registered(plane, 1) ^ darker.replicate(len(circle)), 2) for plane in planes
        )
        darker = pipe.registered(darker, 2)
        settled: Value = Const(0, len(circle))
        decisive: Value = Cat()
        cycles = 3
        for plane in (*planes, Const(0, len(circle))):
            arcs = pipe.registered(_arcs(ones), cycles)
            ones, settled, decisive, darker = (
                pipe.registered(value, cycles) for value in (ones, settled, decisive, darker)
            )
            bit = arcs.any()
            settled = settled | (ones ^ bit.replicate(len(circle)))
            following = delayed(m, plane, cycles - 2)
            ones = pipe.registered((ones & settled) | (following & ~settled), cycles + 1)
            settled = pipe.registered(settled, cycles + 1)
            decisive = pipe.registered(Cat(bit, decisive), cycles + 1)
            darker = pipe.registered(darker, cycles + 1)
            cycles += 2
        return decisive, darker, cycles


def _arcs(ones: Value) -> Value:
    """Which arcs of nine are all ones: eight pixels from an odd place on, and one more before or behind them."""
    evens, odds = ones[: len(CIRCLE) // 2], ones[len(CIRCLE) // 2 :]
    two = odds & evens.rotate_right(1)
    four = two & two.rotate_right(1)
    eight = four & four.rotate_right(2)
    return eight & (evens | odds.rotate_right(4))
