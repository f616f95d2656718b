"""Selects the mutual ones among nearest neighbours."""

from amaranth import Cat, Module, Mux, Signal
from amaranth.lib import data, stream, wiring
from amaranth.lib.wiring import In, Out

from hdl.lib.component import Component
from hdl.lib.delay import delayed
from hdl.lib.skid_buffer import SkidBuffer
from hdl.lib.views import view_signal
from hdl.matching.hamming import nearest_layout
from hdl.matching.nearest_neighbours import RESULT_CYCLES


def pair_layout(*, bits: int, max_features: int) -> data.StructLayout:
    """Two mutually nearest features: indices, distance, and margin (second smallest distance minus smallest)."""
    distance, index = range(bits + 1), range(max_features)
    return data.StructLayout({"left": index, "right": index, "distance": distance, "margin": distance})


class MutualNearestNeighbours(Component):
    """Pairs of features that are each other's nearest, in rising left index; one row per clock while ``o`` accepts.

    Parameters
    ----------
    bits, max_features : int
        As in the `NearestNeighbours` whose results it reads.
    """

    i_start: In(1)
    """Starts a walk over the rows; the previous one must have ended."""
    i_left_count: Signal
    """Must not change during the walk and one clock before it."""
    o_busy: Out(1)
    """High from the clock after ``i_start`` until the last pair has been accepted."""
    o_row_index: Signal
    o_column_index: Signal
    o_read: Out(1)
    i_row: data.View
    i_column: data.View
    """To and from `NearestNeighbours`, which gives a row and a column (`hdl.matching.hamming.nearest_layout`)."""
    o: stream.Interface
    """Stream of `pair_layout`. Its second smallest distance is the smaller of its row's and its column's; a missing one
    counts as ``bits``."""

    def __init__(self, *, bits: int, max_features: int) -> None:
        self.bits = bits
        self.max_features = max_features
        nearest, index = nearest_layout(bits=bits, max_features=max_features), range(max_features)
        super().__init__(
            i_left_count=In(range(max_features + 1)),
            o_row_index=Out(index),
            o_column_index=Out(index),
            i_row=In(nearest),
            i_column=In(nearest),
            o=Out(stream.Signature(pair_layout(bits=bits, max_features=max_features))),
        )

    def elaborate(self, platform: object) -> Module:
        """A pipeline that stalls while a pair waits: read the row, read its column, compare, subtract."""
        m = Module()
        # Its ready comes from a register; straight from the output, ready would be the slowest path.
        m.submodules.buffer = buffer = SkidBuffer(shape=self.o.payload.shape())
        wiring.connect(m, buffer.o, wiring.flipped(self.o))
        walking = Signal()
        left = Signal(range(self.max_features))
        valid = Signal(2 * RESULT_CYCLES)
        lefts = [Signal.like(left, name=f"left{n}", reset_less=True) for n in range(len(valid))]
        rows = [view_signal(self.i_row.shape(), name=f"row{n}", reset_less=True) for n in range(RESULT_CYCLES)]
        row, column = rows[-1], self.i_column
        last_left = delayed(m, (self.i_left_count - 1)[: len(left)], 1)
        is_mutual = Signal()
        pair = view_signal(self.o.payload.shape(), reset_less=True)
        second = Signal.like(row.second, reset_less=True)
        m.d.comb += [
            self.o_read.eq(buffer.i.ready),
            self.o_row_index.eq(left),
            self.o_column_index.eq(self.i_row.index),
            self.o_busy.eq(walking | valid.any() | is_mutual | self.o.valid),
            buffer.i.valid.eq(is_mutual),
            buffer.i.payload.eq(pair),
            # All ones: there is no second neighbour.
            buffer.i.payload.margin.eq(Mux(second.all(), self.bits, second) - pair.distance),
        ]
        with m.If(self.o_read):
            m.d.sync += [
                left.eq(left + 1),
                valid.eq(Cat(walking, valid[:-1])),
                Cat(lefts).eq(Cat(left, lefts[:-1])),
                Cat(rows).eq(Cat(self.i_row, rows[:-1])),
                is_mutual.eq(valid[-1] & (column.index == lefts[-1])),
                pair.left.eq(lefts[-1]),
                pair.right.eq(row.index),
                pair.distance.eq(row.best),
                second.eq(Mux(row.second < column.second, row.second, column.second)),
            ]
            with m.If(left == last_left):
                m.d.sync += walking.eq(0)
        with m.If(self.i_start):
            m.d.sync += [walking.eq(self.i_left_count.any()), left.eq(0)]
        return m
