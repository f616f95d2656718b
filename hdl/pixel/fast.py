"""FAST corners (thesis, equation II-1): the 9-of-16 segment test, and its score bit by bit."""

from typing import Any

from amaranth import Cat, Const, Module, Mux, Value
from amaranth.lib import data
from amaranth.lib.wiring import In, Out

from golden_model.config import check_range
from golden_model.formats import PIXEL, RESPONSE_CODE
from golden_model.pixel.fast import CIRCLE, MARGIN_PX
from hdl.lib.component import Component
from hdl.lib.delay import Pipe, check_aligned, delayed
from hdl.pixel.window import Window
from hdl.streams import beat, carry_scan, each_pixel

WINDOW_PX = 2 * MARGIN_PX + 1
_EVENS_THEN_ODDS = (*CIRCLE[0::2], *CIRCLE[1::2])
"""The order of the circle's pixels in a word: every arc is then a combination of rotations of the two halves."""


class Fast(Component):
    """The largest threshold at which a pixel passes the segment test.

    The score follows from a single pixel of the circle, called *decisive* here: take the darkest pixel of each arc of
    nine, and the brightest of these. This holds for arcs brighter than the centre; for darker arcs all pixels are
    complemented first. Both cases cannot occur at the same pixel, because any two arcs of nine overlap; so the first
    test, which pixels are brighter than the centre, decides whether to complement.

    The bits of the decisive pixel follow one after another, the highest first. Each is the answer to the same question:
    do nine contiguous pixels have a one here? A pixel whose bit differs from the answer is larger or smaller than the
    decisive one, whatever its lower bits are; from then on it counts as all ones or all zeros.

    Parameters
    ----------
    lag_px : int
        At least 3. With more, the window lies further up and left, so that results meet those of a larger window.

    Raises
    ------
    ValueError
        For a smaller lag.
    """

    i: data.View
    """Beats of ``column``: ``lines`` gray pixels, the newest line first."""
    i_threshold_code: In(RESPONSE_CODE.bits)
    """Smallest score that survives, in gray levels. Stable during a frame."""
    o: data.View
    """Beats of ``code``, `golden_model.pixel.fast.response_code`."""

    lines: int
    """Gray pixels of a column, ``lag_px + 4``."""
    # Clocks: window; brighter pixels; their arcs; complement; two for each bit; difference; threshold.
    latency_cycles = Window.latency_cycles + 3 + 2 * PIXEL.bits + 2

    def __init__(self, *, lag_px: int = MARGIN_PX, pixels_per_clock: int = 1) -> None:
        check_range("lag_px", lag_px, MARGIN_PX)
        self.lag_px = lag_px
        self.pixels_per_clock = pixels_per_clock
        self.lines = lag_px + MARGIN_PX + 1
        column = data.ArrayLayout(PIXEL.bits, self.lines)
        self._window = Window(shape=column, columns=self.lines, pixels_per_clock=pixels_per_clock)
        super().__init__(i=In(beat(pixels_per_clock, column=column)), o=Out(beat(pixels_per_clock, code=PIXEL.bits)))

    def elaborate(self, platform: object) -> Module:
        """Find the decisive pixel of the circle, subtract the centre, apply the threshold."""
        m = Module()
        m.submodules.window = window = self._window
        m.d.comb += window.i.eq(self.i)
        carry_scan(m, window.o, self.o, self.latency_cycles - window.latency_cycles)
        pipe = Pipe(m, window.o.valid)
        for columns, o_code in zip(window.windows, each_pixel(self.o.code, self.pixels_per_clock), strict=True):
            m.d.comb += o_code.eq(self._code(m, pipe, columns))
        return m

    def _code(self, m: Module, pipe: Pipe, columns: list[Any]) -> Value:
        """Compute the response code of the pixel ``lag_px`` left of and above the newest one."""
        centre, *circle = (columns[self.lag_px - x][self.lag_px - y] for x, y in ((0, 0), *_EVENS_THEN_ODDS))
        decisive, darker, cycles = self._decisive(m, pipe, circle, centre)
        codes_cycles = self._window.latency_cycles + cycles + 2
        check_aligned("latency_cycles of FAST", scan=self.latency_cycles, codes=codes_cycles)
        reference = delayed(m, pipe.registered(centre, 0), cycles - 1) ^ darker.replicate(PIXEL.bits)
        # decisive - reference - 1; the carry out is 1 where the result is not negative.
        difference = decisive + ~reference
        score = pipe.registered(Mux(difference[-1], difference[: PIXEL.bits], 0), cycles)
        code = Mux(score < self.i_threshold_code, 0, score)
        return pipe.registered(code, cycles + 1)

    @staticmethod
    def _decisive(m: Module, pipe: Pipe, circle: list[Value], centre: Value) -> tuple[Value, Value, int]:
        """Return the decisive pixel (complemented for a darker arc), whether the arc is darker, and their latency.

        ``ones`` is the value that each pixel counts as in the current bit; ``settled`` says whether the pixel differed
        from the answer in an earlier bit. Each bit takes two clocks: which arcs are all ones, then whether any is.
        """
        # Registered in the pipe, not only delayed: everything then holds still while Harris is chosen.
        planes = [pipe.registered(Cat(pixel[bit] for pixel in circle), 0) for bit in reversed(range(PIXEL.bits))]
        brighter = pipe.registered(Cat(pixel > centre for pixel in circle), 0)
        darker = ~pipe.registered(_arcs(brighter), 1).any()
        ones, *planes = (
            pipe.registered(pipe.registered(plane, 1) ^ darker.replicate(len(circle)), 2) for plane in planes
        )
        darker = pipe.registered(darker, 2)
        settled: Value = Const(0, len(circle))
        # Nothing yet: the bits are shifted in, the highest first.
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
    """Bits of the arcs of nine that are all ones: eight pixels from an odd position on, and one before or after."""
    evens, odds = ones[: len(CIRCLE) // 2], ones[len(CIRCLE) // 2 :]
    two = odds & evens.rotate_right(1)
    four = two & two.rotate_right(1)
    eight = four & four.rotate_right(2)
    return eight & (evens | odds.rotate_right(4))
