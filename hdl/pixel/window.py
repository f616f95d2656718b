"""Line memories and windows: from beats of pixels to beats of columns and of windows."""

from __future__ import annotations

from amaranth import Cat, Module, Shape, ShapeLike, Signal, Value
from amaranth.lib import data, wiring
from amaranth.lib.wiring import In, Out

from hdl.lib.delay import delayed
from hdl.lib.line_memory import LineMemory
from hdl.lib.weighted_sum import WeightedSum
from hdl.streams import beat, carry_scan


class LineBuffer(wiring.Component):
    """The column of pixels above each pixel, from one memory that holds the previous lines.

    Parameters
    ----------
    shape : ShapeLike
        Of a pixel.
    lines : int
        Number of previous lines.
    width_px : int
        Largest width of a line, at least 5.

    Members
    -------
    i : In(beat(pixel))
    o : Out(beat(column))
        ``column[r]`` is the pixel r lines above the scan position.

    Attributes
    ----------
    latency_cycles : int

    Raises
    ------
    ValueError
        For fewer than 1 line, or a width below 5.
    """

    i: data.View
    o: data.View

    latency_cycles = LineMemory.latency_cycles + 1

    def __init__(self, *, shape: ShapeLike, lines: int, width_px: int) -> None:
        if lines < 1:
            raise ValueError(f"lines is {lines}; it must be at least 1")
        if width_px < 5:
            raise ValueError(f"width_px is {width_px}; it must be at least 5, the clocks from a read to its write")
        self.shape = shape
        self.lines = lines
        self.width_px = width_px
        super().__init__({"i": In(beat(pixel=shape)), "o": Out(beat(column=data.ArrayLayout(shape, lines + 1)))})

    def elaborate(self, platform: object) -> Module:
        """Read the column at x, register it, write it back shifted by one line.

        Lines of at least 5 px keep each write ahead of the next read of the same address.
        """
        m = Module()
        m.submodules.memory = lines = LineMemory(shape=data.ArrayLayout(self.shape, self.lines), depth=self.width_px)
        carry_scan(m, self.i, self.o, self.latency_cycles)
        column = Signal.like(self.o.column, reset_less=True)
        pixel = delayed(m, self.i.pixel, lines.latency_cycles)
        with m.If(delayed(m, self.i.valid, lines.latency_cycles, reset_less=False)):
            m.d.sync += column.eq(Cat(pixel, lines.o_word))
        m.d.comb += [
            lines.i_read_address.eq(self.i.x),
            lines.i_read.eq(self.i.valid),
            self.o.column.eq(column),
            lines.i_write_address.eq(self.o.x),
            lines.i_write.eq(self.o.valid),
            # The oldest line drops out.
            lines.i_word.eq(Cat(column)[: len(Value.cast(lines.i_word))]),
        ]
        return m


class Window(wiring.Component):
    """The most recent columns side by side.

    Parameters
    ----------
    shape : ShapeLike
        Of a column.
    columns : int

    Members
    -------
    i : In(beat(column))
    o : Out(beat(columns))
        ``columns[n]`` is the column n pixels left of the scan position.

    Attributes
    ----------
    latency_cycles : int
    """

    i: data.View
    o: data.View

    latency_cycles = 1

    def __init__(self, *, shape: ShapeLike, columns: int) -> None:
        if columns < 1:
            raise ValueError(f"columns is {columns}; it must be at least 1")
        self.shape = shape
        self.columns = columns
        super().__init__({"i": In(beat(column=shape)), "o": Out(beat(columns=data.ArrayLayout(shape, columns)))})

    def elaborate(self, platform: object) -> Module:
        """Shift a column in at every valid beat."""
        m = Module()
        carry_scan(m, self.i, self.o, self.latency_cycles)
        columns = [Signal(self.shape, name=f"column{n}", reset_less=True) for n in range(self.columns)]
        with m.If(self.i.valid):
            m.d.sync += [new.eq(old) for new, old in zip(columns, [self.i.column, *columns], strict=False)]
        m.d.comb += [target.eq(column) for target, column in zip(self.o.columns, columns, strict=True)]
        return m


class OffsetColumns(wiring.Component):
    """Columns from further up and left: adds ``distance_px`` to the lag of the blocks behind it.

    Parameters
    ----------
    shape : ShapeLike
        Of a pixel.
    rows : int
        Pixels of an output column.
    distance_px : int
        Offset of the output columns, up and left.

    Members
    -------
    i : In(beat(column))
        ``distance_px + rows`` pixels, the newest line first.
    o : Out(beat(column))

    Attributes
    ----------
    latency_cycles : int
    """

    i: data.View
    o: data.View

    latency_cycles = Window.latency_cycles

    def __init__(self, *, shape: ShapeLike, rows: int, distance_px: int) -> None:
        self.distance_px = distance_px
        self._window = Window(shape=data.ArrayLayout(shape, rows), columns=distance_px + 1)
        super().__init__(
            {
                "i": In(beat(column=data.ArrayLayout(shape, distance_px + rows))),
                "o": Out(beat(column=data.ArrayLayout(shape, rows))),
            }
        )

    def elaborate(self, platform: object) -> Module:
        """The leftmost column of a window."""
        m = Module()
        m.submodules.window = window = self._window
        carry_scan(m, self.i, window.i, 0)
        carry_scan(m, window.o, self.o, 0)
        m.d.comb += [pixel.eq(self.i.column[self.distance_px + n]) for n, pixel in enumerate(window.i.column)]
        m.d.comb += self.o.column.eq(window.o.columns[self.distance_px])
        return m


class SeparableSum(wiring.Component):
    """Weighted sum over a window: first down each column, then along the line.

    Parameters
    ----------
    vertical, horizontal : tuple of int
        Weights, for the newest line and column first.
    shape : Shape
        Of a pixel.

    Members
    -------
    i : In(beat(column))
        ``len(vertical)`` pixels, the newest line first.
    o : Out(beat(sum))
        As wide as the range of the sum needs and no wider.

    Attributes
    ----------
    latency_cycles : int
    """

    i: data.View
    o: data.View

    def __init__(self, *, vertical: tuple[int, ...], horizontal: tuple[int, ...], shape: Shape) -> None:
        self._down = WeightedSum(weights=vertical, shape=shape)
        column_sum = self._down.o_sum.shape()
        self._window = Window(shape=column_sum, columns=len(horizontal))
        self._along = WeightedSum(weights=horizontal, shape=column_sum)
        self.latency_cycles = self._down.latency_cycles + self._window.latency_cycles + self._along.latency_cycles
        super().__init__(
            {
                "i": In(beat(column=data.ArrayLayout(shape, len(vertical)))),
                "o": Out(beat(sum=self._along.o_sum.shape())),
            }
        )

    def elaborate(self, platform: object) -> Module:
        """Sum each column, keep the recent sums side by side, add them up."""
        m = Module()
        m.submodules.down, m.submodules.window, m.submodules.along = self._down, self._window, self._along
        carry_scan(m, self.i, self.o, self.latency_cycles)
        m.d.comb += [
            self._down.i_valid.eq(self.i.valid),
            self._window.i.valid.eq(self._down.o_valid),
            self._window.i.column.eq(self._down.o_sum),
            self._along.i_valid.eq(self._window.o.valid),
            self.o.sum.eq(self._along.o_sum),
        ]
        m.d.comb += [value.eq(pixel) for value, pixel in zip(self._down.i_values, self.i.column, strict=True)]
        m.d.comb += [
            value.eq(column) for value, column in zip(self._along.i_values, self._window.o.columns, strict=True)
        ]
        return m
