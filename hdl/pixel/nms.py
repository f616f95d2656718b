"""Non-maximum suppression (thesis, section III.6.1.1), with the rules for ties of Harris and of FAST."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

from amaranth import Cat, Module, Mux, Signal, Value
from amaranth.lib import data, wiring
from amaranth.lib.wiring import In, Out

from golden_model.formats import PIXEL, RESPONSE_CODE
from hdl.lib.delay import Pipe, delayed
from hdl.pixel.window import LineBuffer
from hdl.streams import beat, carry_scan

CODE = RESPONSE_CODE.bits
NEIGHBOURHOOD = {"code": CODE, "left": CODE, "right": CODE, "up": CODE, "down": CODE}
"""The code where it survives, else 0; and the codes of the four neighbours in any case."""


class Suppression(wiring.Component):
    """Keep a response only where it is the largest of the window around it.

    Harris: a response survives if it is greater than every response before it in raster order and not smaller than any
    after it, so that the first of equal ones stays. Both maxima are built from maxima of columns and of growing runs
    of columns. FAST: the window is 3x3, scores have 8 bits, and none of several equal ones stays, so that a comparison
    with each neighbour suffices.

    Parameters
    ----------
    radius_px : {1, 3}
        Harris's window is (2 radius_px + 1) squared.
    width_px : int
        Largest width of a line.

    Members
    -------
    i : In(beat(code))
    i_fast : In(1)
        The responses come from FAST. Stable during a frame.
    o : Out(beat(code, left, right, up, down))

    Attributes
    ----------
    lag_px : int
    latency_cycles : int

    Raises
    ------
    ValueError
        For another radius.
    """

    i: data.View
    i_fast: Signal
    o: data.View

    def __init__(self, *, radius_px: int, width_px: int) -> None:
        if radius_px not in (1, 3):
            raise ValueError(f"radius_px is {radius_px}; valid: 1, 3")
        self.radius_px = radius_px
        self.lag_px = radius_px
        self._lines = LineBuffer(shape=CODE, lines=2 * radius_px, width_px=width_px)
        self._column_cycles = (radius_px - 1).bit_length()
        self._run_cycles = len(_run_lengths(2 * radius_px + 1)) - 1
        self.latency_cycles = self._lines.latency_cycles + self._column_cycles + self._run_cycles + 3
        super().__init__({"i": In(beat(code=CODE)), "i_fast": In(1), "o": Out(beat(**NEIGHBOURHOOD))})

    def elaborate(self, platform: object) -> Module:
        """Maxima before and after the centre in raster order, then the decision."""
        m = Module()
        m.submodules.lines = lines = self._lines
        m.d.comb += lines.i.pixel.eq(self.i.code)
        carry_scan(m, self.i, lines.i, 0)
        carry_scan(m, lines.o, self.o, self.latency_cycles - lines.latency_cycles)
        pipe = _Pipe(m, lines.o.valid)
        radius, column = self.radius_px, lines.o.column
        runs = 2 * radius + 1
        above = pipe.largest_of_run(runs, *pipe.largest([column[n] for n in range(radius + 1, runs)]))
        below = pipe.largest_of_run(runs, *pipe.largest([column[n] for n in range(radius)]))
        cycles = above[1]
        # The centre line counts on both sides: pixels left of the centre come before it, those to the right after it.
        beside, beside_cycles = pipe.largest_of_run(radius, column[radius], 0)
        beside = delayed(m, beside, cycles - beside_cycles)
        before, _ = pipe.largest([above[0], pipe.earlier(beside, cycles, radius + 1)[-1]], cycles)
        after, cycles = pipe.largest([below[0], beside], cycles)

        up, line, down = (
            [now, *pipe.earlier(now, cycles, radius + 1)]
            for now in (delayed(m, column[radius + offset], cycles) for offset in (1, 0, -1))
        )
        centre = line[radius]
        around = [line[radius - 1], line[radius + 1], *up[radius - 1 : radius + 2], *down[radius - 1 : radius + 2]]
        larger = delayed(m, Cat(centre[: PIXEL.bits] > neighbour[: PIXEL.bits] for neighbour in around), 1)
        largest = delayed(m, (centre > before) & (centre >= after), 1)
        survives = Mux(self.i_fast, larger.all(), largest)
        m.d.comb += self.o.code.eq(delayed(m, Mux(survives, delayed(m, centre, 1), 0), 1))
        beside_centre = {"left": line[radius + 1], "right": line[radius - 1], "up": up[radius], "down": down[radius]}
        m.d.comb += [self.o[name].eq(delayed(m, code, 2)) for name, code in beside_centre.items()]
        return m


class _Pipe(Pipe):
    """Current and earlier values of a beat; ``cycles`` is the delay of a value against the start of the pipe."""

    def earlier(self, value: Value, cycles: int, beats: int) -> list[Signal]:
        """The value 1, 2, ..., ``beats`` beats ago."""
        values = []
        for _ in range(beats):
            value = self.registered(value, cycles)
            values.append(value)
        return values

    def largest(self, values: Sequence[Value], cycles: int = 0) -> tuple[Value, int]:
        """The largest of the values, and its ``cycles``."""
        while len(values) > 1:
            pairs = [_larger(*pair) for pair in zip(values[0::2], values[1::2], strict=False)]
            values = [self.registered(value, cycles) for value in (*pairs, *values[len(values) & ~1 :])]
            cycles += 1
        return values[0], cycles

    def largest_of_run(self, beats: int, value: Value, cycles: int) -> tuple[Value, int]:
        """The largest of the last ``beats`` values, and its ``cycles``, by maxima of runs of doubling length."""
        for length, longer in pairwise(_run_lengths(beats)):
            before = self.earlier(value, cycles, longer - length)[-1]
            value = self.registered(_larger(value, before), cycles)
            cycles += 1
        return value, cycles


def _larger(a: Value, b: Value) -> Value:
    return Mux(a > b, a, b)


def _run_lengths(beats: int) -> list[int]:
    lengths = [1]
    while lengths[-1] < beats:
        lengths.append(min(2 * lengths[-1], beats))
    return lengths
