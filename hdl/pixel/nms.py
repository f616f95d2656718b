"""Non-maximum suppression (thesis, section III.6.1.1), with the rules for ties of Harris and of FAST."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

from amaranth import Cat, Module, Mux, Signal, Value
from amaranth.lib import data
from amaranth.lib.wiring import In, Out

from golden_model.config import check_choice
from golden_model.formats import PIXEL, RESPONSE_CODE
from hdl.lib.component import Component
from hdl.lib.delay import Pipe, check_aligned, delayed
from hdl.pixel.window import LineBuffer
from hdl.streams import beat, carry_scan, each_pixel, pixel_beats

CODE = RESPONSE_CODE.bits
NEIGHBOURHOOD = {"code": CODE, "left": CODE, "right": CODE, "up": CODE, "down": CODE}
"""The code where it survives, else 0; and in any case the codes of the four neighbours."""


class Suppression(Component):
    """Keeps a response only where it is the largest in the window around it.

    Harris: a response survives if it is greater than every response before it in raster order and not smaller than any
    after it, so that the first of equal ones stays. Both maxima are built from maxima of columns and of growing runs
    of columns. FAST: the window is 3x3, scores have 8 bits, and of equal ones none stays, so that a comparison with
    each neighbour suffices. With either rule, of two horizontal neighbours at most one survives.

    Parameters
    ----------
    radius_px : {1, 3}
        Harris's window is (2 radius_px + 1) squared.
    width_px : int
        Largest width of a line.
    """

    i: data.View
    """Beats of ``code``."""
    i_fast: Signal
    """The responses come from FAST. Stable during a frame."""
    o: data.View
    """Beats of `NEIGHBOURHOOD`."""

    def __init__(self, *, radius_px: int, width_px: int, pixels_per_clock: int = 1) -> None:
        check_choice("radius_px", radius_px, (1, 3))
        self.radius_px = radius_px
        self.pixels_per_clock = pixels_per_clock
        self.lag_px = radius_px
        self._lines = LineBuffer(shape=CODE, lines=2 * radius_px, width_px=width_px, pixels_per_clock=pixels_per_clock)
        self._column_cycles = (radius_px - 1).bit_length()
        self._run_cycles = len(_run_lengths(2 * radius_px + 1)) - 1
        # Maxima of columns and of runs; then of both sides, the comparison, the choice.
        self.latency_cycles = self._lines.latency_cycles + self._column_cycles + self._run_cycles + 3
        super().__init__(
            i=In(beat(pixels_per_clock, code=CODE)), i_fast=In(1), o=Out(beat(pixels_per_clock, **NEIGHBOURHOOD))
        )

    def elaborate(self, platform: object) -> Module:
        """Maxima before and after the centre in raster order, then the decision."""
        m = Module()
        m.submodules.lines = lines = self._lines
        m.d.comb += lines.i.pixel.eq(self.i.code)
        carry_scan(m, self.i, lines.i, 0)
        carry_scan(m, lines.o, self.o, self.latency_cycles - lines.latency_cycles)
        pipe = _Pipe(m, lines.o.valid)
        columns = each_pixel(lines.o.column, self.pixels_per_clock)
        radius, column = self.radius_px, [list(line) for line in zip(*columns, strict=True)]
        runs = 2 * radius + 1
        above = pipe.largest_of_run(runs, *pipe.largest([column[n] for n in range(radius + 1, runs)]))
        below = pipe.largest_of_run(runs, *pipe.largest([column[n] for n in range(radius)]))
        cycles = above[1]
        # The centre line counts on both sides: pixels left of the centre come before it, those to the right after it.
        sides, side_cycles = pipe.largest_of_run(radius, column[radius], 0)
        besides = []
        for side in sides:
            beside = delayed(m, side, cycles - side_cycles)
            besides.append(beside)
        before, _ = pipe.largest([above[0], pipe.earlier(besides, cycles, radius + 1)[-1]], cycles)
        after, cycles = pipe.largest([below[0], besides], cycles)
        # The comparison and the choice follow.
        codes_cycles = lines.latency_cycles + cycles + 2
        check_aligned("latency_cycles of the suppression", scan=self.latency_cycles, codes=codes_cycles)

        lines_around = []
        for offset in (1, 0, -1):
            now = [delayed(m, value, cycles) for value in column[radius + offset]]
            lines_around.append([now, *pipe.earlier(now, cycles, radius + 1)])
        for n, out in enumerate(pixel_beats(self.o, self.pixels_per_clock)):
            around = [[values[n] for values in line] for line in lines_around]
            self._decide(m, out, around, before[n], after[n])
        return m

    def _decide(self, m: Module, out: data.View, lines: list[Line], before: Value, after: Value) -> None:
        """Keep the code of a pixel or not; ``lines`` are those above, at and below it, each from right to left."""
        up, line, down = lines
        radius = self.radius_px
        centre = line[radius]
        around = [line[radius - 1], line[radius + 1], *up[radius - 1 : radius + 2], *down[radius - 1 : radius + 2]]
        # Scores of FAST have 8 bits: comparators of the full width are needed for Harris's maxima alone.
        larger = delayed(m, Cat(centre[: PIXEL.bits] > neighbour[: PIXEL.bits] for neighbour in around), 1)
        largest = delayed(m, (centre > before) & (centre >= after), 1)
        survives = Mux(self.i_fast, larger.all(), largest)
        m.d.comb += out.code.eq(delayed(m, Mux(survives, delayed(m, centre, 1), 0), 1))
        beside_centre = {"left": line[radius + 1], "right": line[radius - 1], "up": up[radius], "down": down[radius]}
        m.d.comb += [out[name].eq(delayed(m, code, 2)) for name, code in beside_centre.items()]


Line = list[Value]
"""Values of a line or of a beat, pixel by pixel."""


class _Pipe(Pipe):
    """Current and earlier values of each pixel of a beat; ``cycles`` is their delay against the start of the pipe."""

    def earlier(self, values: Line, cycles: int, distance_px: int) -> list[Line]:
        """Return the values 1, 2, ..., ``distance_px`` pixels further left."""
        count = len(values)
        line = values[::-1]
        while len(line) < distance_px + count:
            for newer in line[-count:]:
                value = self.registered(newer, cycles)
                line.append(value)
        return [line[distance : distance + count][::-1] for distance in range(1, distance_px + 1)]

    def largest(self, values: Sequence[Line], cycles: int = 0) -> tuple[Line, int]:
        """Return the largest of the values, and its ``cycles``."""
        while len(values) > 1:
            pairs = [_larger(*pair) for pair in zip(values[0::2], values[1::2], strict=False)]
            values = [
                [self.registered(value, cycles) for value in line] for line in (*pairs, *values[len(values) & ~1 :])
            ]
            cycles += 1
        return values[0], cycles

    def largest_of_run(self, run_px: int, values: Line, cycles: int) -> tuple[Line, int]:
        """Return the largest of the last ``run_px`` values and its ``cycles``, by maxima of runs of doubling length."""
        for length, longer in pairwise(_run_lengths(run_px)):
            before = self.earlier(values, cycles, longer - length)[-1]
            larger = _larger(values, before)
            for n, each in enumerate(larger):
                value = self.registered(each, cycles)
                larger[n] = value
            values = larger
            cycles += 1
        return values, cycles


def _larger(a: Line, b: Line) -> Line:
    return [Mux(one > other, one, other) for one, other in zip(a, b, strict=True)]


def _run_lengths(run_px: int) -> list[int]:
    lengths = [1]
    while lengths[-1] < run_px:
        lengths.append(min(2 * lengths[-1], run_px))
    return lengths
