"""Line memories and windows: from beats of pixels to beats of columns and of windows."""

from typing import Any

from amaranth import Cat, Module, Shape, ShapeLike, Signal, Value
from amaranth.lib import data
from amaranth.lib.wiring import In, Out

from golden_model.config import check_range
from hdl.lib.component import Component
from hdl.lib.delay import delayed
from hdl.lib.line_memory import LineMemory
from hdl.lib.weighted_sum import WeightedSum
from hdl.streams import add_submodules, beat, carry_scan, each_pixel, pixels, pixelwise


class LineBuffer(Component):
    """The column of pixels above each pixel, from one memory that holds the previous lines.

    Parameters
    ----------
    shape : ShapeLike
        Shape of a pixel.
    lines : int
        Number of previous lines.
    width_px : int
        Largest width of a line, at least 5 beats.
    pixels_per_clock : {1, 2}
        Pixels of a beat. Two share a word of the memory, which then has half as many words.

    Raises
    ------
    ValueError
        For a width below 5 beats.
    """

    i: data.View
    """Beats of ``pixel``."""
    o: data.View
    """Beats of ``column``, where ``column[r]`` is the pixel r lines above the scan position."""

    latency_cycles = LineMemory.latency_cycles + 1

    def __init__(self, *, shape: ShapeLike, lines: int, width_px: int, pixels_per_clock: int = 1) -> None:
        check_range("lines", lines, 1)
        # A column is written back after it has been read, and before it is read again.
        check_range("width_px", width_px, 5 * pixels_per_clock)
        self.shape = shape
        self.lines = lines
        self.width_px = width_px
        self.pixels_per_clock = pixels_per_clock
        super().__init__(
            i=In(beat(pixels_per_clock, pixel=shape)),
            o=Out(beat(pixels_per_clock, column=data.ArrayLayout(shape, lines + 1))),
        )

    def elaborate(self, platform: object) -> Module:
        """Read the column at x, register it, write it back shifted by one line.

        Lines of at least 5 beats keep each write ahead of the next read of the same address.
        """
        m = Module()
        count = self.pixels_per_clock
        m.submodules.memory = lines = LineMemory(
            shape=pixels(data.ArrayLayout(self.shape, self.lines), count), depth=-(-self.width_px // count)
        )
        carry_scan(m, self.i, self.o, self.latency_cycles)
        column = Signal.like(self.o.column, reset_less=True)
        pixel = delayed(m, self.i.pixel, lines.latency_cycles)
        with m.If(delayed(m, self.i.valid, lines.latency_cycles, reset_less=False)):
            m.d.sync += column.eq(Cat(pixelwise(count, pixel, lines.o_word)))
        # The oldest line drops out.
        kept_bits = len(Value.cast(lines.i_word)) // count
        kept = (Cat(each)[:kept_bits] for each in each_pixel(column, count))
        # Addressed by x and not by a counter: a frame that breaks off leaves nothing out of step.
        m.d.comb += [
            lines.i_read_address.eq(self.i.x[count - 1 :]),
            lines.i_read.eq(self.i.valid),
            self.o.column.eq(column),
            lines.i_write_address.eq(self.o.x[count - 1 :]),
            lines.i_write.eq(self.o.valid),
            lines.i_word.eq(Cat(kept)),
        ]
        return m


class Window(Component):
    """The most recent columns side by side.

    Parameters
    ----------
    shape : ShapeLike
        Shape of a column.
    columns : int
        Columns of the window around a pixel.
    """

    i: data.View
    """Beats of ``column``."""
    o: data.View
    """Beats of ``columns``, where ``columns[n]`` is the column n pixels left of the beat's rightmost pixel. The windows
    of two pixels overlap, so that there is one column more than in one window."""

    latency_cycles = 1

    def __init__(self, *, shape: ShapeLike, columns: int, pixels_per_clock: int = 1) -> None:
        check_range("columns", columns, 1)
        self.shape = shape
        self.columns = columns
        self.pixels_per_clock = pixels_per_clock
        super().__init__(
            i=In(beat(pixels_per_clock, column=shape)),
            o=Out(beat(columns=data.ArrayLayout(shape, columns + pixels_per_clock - 1))),
        )

    @property
    def windows(self) -> list[list[Any]]:
        """Windows of the beat's pixels: the column at the pixel's own scan position, and those left of it."""
        starts = reversed(range(self.pixels_per_clock))
        return [[self.o.columns[start + n] for n in range(self.columns)] for start in starts]

    def elaborate(self, platform: object) -> Module:
        """A shift register, which takes the beat's columns in."""
        m = Module()
        carry_scan(m, self.i, self.o, self.latency_cycles)
        columns = [Signal(self.shape, name=f"column{n}", reset_less=True) for n in range(len(self.o.columns))]
        # The rightmost pixel of a beat is the newest.
        newest = reversed(each_pixel(self.i.column, self.pixels_per_clock))
        with m.If(self.i.valid):
            m.d.sync += [new.eq(old) for new, old in zip(columns, [*newest, *columns], strict=False)]
        m.d.comb += [target.eq(column) for target, column in zip(self.o.columns, columns, strict=True)]
        return m


class OffsetColumns(Component):
    """Takes columns of gray from further up and left, which adds ``distance_px`` to the lag of the blocks behind it.

    Parameters
    ----------
    rows : int
        Pixels of an output column.
    distance_px : int
        Offset of the output columns, up and left.
    """

    i: data.View
    """Beats of ``column``: ``distance_px + rows`` pixels, the newest line first."""
    o: data.View
    """Beats of ``column``: ``rows`` pixels, the newest line first."""

    latency_cycles = Window.latency_cycles

    def __init__(self, *, rows: int, distance_px: int, pixels_per_clock: int = 1) -> None:
        self.rows = rows
        self.distance_px = distance_px
        self.pixels_per_clock = pixels_per_clock
        column = data.ArrayLayout(8, rows)
        self._window = Window(shape=column, columns=distance_px + 1, pixels_per_clock=pixels_per_clock)
        super().__init__(
            i=In(beat(pixels_per_clock, column=data.ArrayLayout(8, distance_px + rows))),
            o=Out(beat(pixels_per_clock, column=column)),
        )

    def elaborate(self, platform: object) -> Module:
        """The leftmost column of a window."""
        m = Module()
        m.submodules.window = window = self._window
        carry_scan(m, self.i, window.i, 0)
        carry_scan(m, window.o, self.o, 0)
        for i_column, column in pixelwise(self.pixels_per_clock, self.i.column, window.i.column):
            m.d.comb += [pixel.eq(i_column[self.distance_px + n]) for n, pixel in enumerate(column)]
        for o_column, left in zip(each_pixel(self.o.column, self.pixels_per_clock), window.windows, strict=True):
            m.d.comb += o_column.eq(left[self.distance_px])
        return m


class SeparableSum(Component):
    """Weighted sum over a window: first down each column, then along the line.

    Parameters
    ----------
    vertical, horizontal : tuple of int
        Weights, for the newest line and column first.
    shape : Shape
        Shape of a pixel.
    """

    i: data.View
    """Beats of ``column``: ``len(vertical)`` pixels, the newest line first."""
    o: data.View
    """Beats of ``sum``, as wide as the range of the sum needs and no wider."""

    def __init__(
        self, *, vertical: tuple[int, ...], horizontal: tuple[int, ...], shape: Shape, pixels_per_clock: int = 1
    ) -> None:
        self.pixels_per_clock = pixels_per_clock
        # Down first: the window then holds one sum per column instead of a column of pixels.
        self._down = [WeightedSum(weights=vertical, shape=shape) for _ in range(pixels_per_clock)]
        column_sum = self._down[0].o_sum.shape()
        self._window = Window(shape=column_sum, columns=len(horizontal), pixels_per_clock=pixels_per_clock)
        self._along = [WeightedSum(weights=horizontal, shape=column_sum) for _ in range(pixels_per_clock)]
        sums = (self._down[0], self._along[0])
        self.latency_cycles = self._window.latency_cycles + sum(each.latency_cycles for each in sums)
        super().__init__(
            i=In(beat(pixels_per_clock, column=data.ArrayLayout(shape, len(vertical)))),
            o=Out(beat(pixels_per_clock, sum=self._along[0].o_sum.shape())),
        )

    def elaborate(self, platform: object) -> Module:
        """Sum each column, keep the recent sums side by side, add them up."""
        m = Module()
        add_submodules(m, "down", self._down)
        m.submodules.window = self._window
        add_submodules(m, "along", self._along)
        carry_scan(m, self.i, self.o, self.latency_cycles)
        m.d.comb += self._window.i.valid.eq(self._down[0].o_valid)
        columns = pixelwise(self.pixels_per_clock, self.i.column, self._window.i.column)
        for down, (column, column_sum) in zip(self._down, columns, strict=True):
            m.d.comb += [down.i_valid.eq(self.i.valid), column_sum.eq(down.o_sum)]
            m.d.comb += [value.eq(pixel) for value, pixel in zip(down.i_values, column, strict=True)]
        sums = each_pixel(self.o.sum, self.pixels_per_clock)
        for along, window, o_sum in zip(self._along, self._window.windows, sums, strict=True):
            m.d.comb += [along.i_valid.eq(self._window.o.valid), o_sum.eq(along.o_sum)]
            m.d.comb += [value.eq(column) for value, column in zip(along.i_values, window, strict=True)]
        return m
