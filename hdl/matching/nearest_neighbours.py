"""Nearest neighbours between two feature sets, in both directions."""

from collections.abc import Sequence
from functools import reduce
from itertools import pairwise
from operator import or_

from amaranth import Cat, Module, Mux, Signal, Value
from amaranth.lib import data
from amaranth.lib.wiring import In, Out
from amaranth.utils import exact_log2

from hdl.lib.component import Component
from hdl.lib.delay import delayed, wait_cycles
from hdl.lib.line_memory import LineMemory
from hdl.lib.views import view_signal
from hdl.matching.feature_banks import READ_CYCLES
from hdl.matching.hamming import Distances, Lane, nearest_layout, position_layout

RESULT_CYCLES = LineMemory.latency_cycles
"""Clocks from an index to the registered row or column."""
COLUMN_CYCLES = RESULT_CYCLES + 1
"""Clocks from a column's index to the first lane: a register stands on the long way from the block RAM."""


class NearestNeighbours(Component):
    """Nearest right feature of every left feature, and nearest left feature of every right one.

    A group of ``lanes`` left descriptors is loaded, and all right ones pass it; between groups the columns are kept in
    a memory. Addresses follow each other without gaps, so a search takes left * right / lanes clocks plus a constant
    (``drain_cycles``). Ties go to the lowest index.

    Parameters
    ----------
    bits : int
        Length of a descriptor.
    lanes : int
        Left descriptors compared at a time, one of `hdl.build.LANES`.
    max_features : int
        Largest number of features of either frame.
    """

    i_start: In(1)
    """Starts a search; the previous one must have ended."""
    i_left_count: Signal
    i_right_count: Signal
    """Both must not change during the search. If either is 0, the search ends at once and leaves no result."""
    o_busy: Out(1)
    """High from the clock after ``i_start`` until the results are readable."""
    o_left_address: Signal
    o_right_address: Signal
    i_left: Signal
    i_right: Signal
    """Addresses for the feature banks, which answer with the descriptors ``READ_CYCLES`` later."""
    i_row_index: Signal
    i_column_index: Signal
    i_read: In(1)
    """Advances the reading of results."""
    o_row: data.View
    """Row ``i_row_index``, see `nearest_layout`; readable while not busy, ``RESULT_CYCLES`` clocks with ``i_read``
    later."""
    o_column: data.View
    """Column ``i_column_index``, likewise."""

    shortest_pass_cycles: int
    """Shortest time for a group: a column must be back in the memory before the next group reads it."""
    drain_cycles: int
    """Clocks from the last address until the results are readable."""

    def __init__(self, *, bits: int, lanes: int, max_features: int) -> None:
        self.bits, self.lanes, self.max_features = bits, lanes, max_features
        self._distances = Distances(bits=bits, lanes=lanes)
        self._nearest = nearest_layout(bits=bits, max_features=max_features)
        self._position = position_layout(lanes=lanes, max_features=max_features)
        self.shortest_pass_cycles = lanes + COLUMN_CYCLES + 1
        self.drain_cycles = READ_CYCLES + self._distances.latency_cycles + lanes + 2
        # The column must reach the first lane with the distance, which is later than the descriptor.
        distance_cycles = READ_CYCLES + self._distances.latency_cycles
        self._column_wait_cycles = wait_cycles("columns", COLUMN_CYCLES, until=distance_cycles)
        index, count = range(max_features), range(max_features + 1)
        super().__init__(
            i_left_count=In(count),
            i_right_count=In(count),
            o_left_address=Out(index),
            o_right_address=Out(index),
            i_left=In(bits),
            i_right=In(bits),
            i_row_index=In(index),
            i_column_index=In(index),
            o_row=Out(self._nearest),
            o_column=Out(self._nearest),
        )

    def elaborate(self, platform: object) -> Module:
        """Addresses, distances, the chain of lanes between both ports of the column memory, and the row memory."""
        m = Module()
        m.submodules.distances = distances = self._distances
        lanes = [
            Lane(lane=k, lanes=self.lanes, bits=self.bits, max_features=self.max_features) for k in range(self.lanes)
        ]
        for k, lane in enumerate(lanes):
            m.submodules[f"lane{k}"] = lane
            m.d.comb += [lane.i_valid.eq(distances.o_valid[k]), lane.i_distance.eq(distances.o_distances[k])]
        for lane, following in pairwise(lanes):
            m.d.comb += following.i_bus.eq(lane.o_bus)
        issuing, slot, group = self._count(m)
        valid, position = self._address(m, issuing, slot, group)
        self._hold_columns(m, valid, position, lanes)
        self._hold_rows(m, lanes)
        return m

    def _count(self, m: Module) -> tuple[Signal, Signal, Signal]:
        """Count the slots of a pass, the passes of a search, and the clocks of draining after it."""
        issuing = Signal()
        slot = Signal(range(max(self.max_features, self.shortest_pass_cycles)))
        group = Signal(self._position["group"].shape)
        last_slot = Signal.like(slot)
        last_group = Signal.like(group)
        drain = Signal(range(self.drain_cycles + 1))
        with m.If(issuing):
            m.d.sync += [slot.eq(slot + 1), drain.eq(self.drain_cycles)]
            with m.If(slot == last_slot):
                m.d.sync += [slot.eq(0), group.eq(group + 1), issuing.eq(group != last_group)]
        with m.Elif(drain.any()):
            m.d.sync += [drain.eq(drain - 1), self.o_busy.eq(drain != 1)]
        with m.If(self.i_start):
            # A shorter pass would read a column before the previous group has written it back.
            short = self.i_right_count < self.shortest_pass_cycles
            any_pair = Signal()
            m.d.comb += any_pair.eq(self.i_left_count.any() & self.i_right_count.any())
            m.d.sync += [
                issuing.eq(any_pair),
                self.o_busy.eq(any_pair),
                group.eq(0),
                last_group.eq((self.i_left_count - 1) >> exact_log2(self.lanes)),
                last_slot.eq(Mux(short, self.shortest_pass_cycles, self.i_right_count) - 1),
            ]
        return issuing, slot, group

    def _address(self, m: Module, issuing: Value, slot: Value, group: Value) -> tuple[Value, data.View]:
        """Read the banks, load the lanes; return validity and position of the right descriptor, with its address."""
        position = view_signal(self._position)
        valid = Signal()
        load = Signal()
        left_valid = Signal()
        # The first slots of a pass also load the lanes: lane k in slot k, just when the first right descriptor
        # reaches it.
        lane = slot[: exact_log2(self.lanes)]
        m.d.comb += [
            self.o_left_address.eq(Cat(lane, group)),
            self.o_right_address.eq(slot),
            valid.eq(issuing & (slot < self.i_right_count)),
            load.eq(issuing & (slot < self.lanes)),
            left_valid.eq(self.o_left_address < self.i_left_count),
            position.first.eq(slot == 0),
            position.last.eq(slot + 1 == self.i_right_count),
            position.first_group.eq(group == 0),
            position.group.eq(group),
            position.right.eq(slot),
        ]
        distances = self._distances
        m.d.comb += [
            distances.i_run.eq(self.o_busy),
            distances.i_valid.eq(delayed(m, valid, READ_CYCLES, reset_less=False)),
            distances.i_load.eq(delayed(m, load, READ_CYCLES, reset_less=False)),
            distances.i_lane.eq(delayed(m, lane, READ_CYCLES)),
            distances.i_left_valid.eq(delayed(m, left_valid, READ_CYCLES)),
            distances.i_left.eq(self.i_left),
            distances.i_right.eq(self.i_right),
        ]
        return valid, position

    def _hold_columns(self, m: Module, valid: Value, position: data.View, lanes: Sequence[Lane]) -> None:
        """Read each column from the memory for the first lane, and write it back from the last lane."""
        m.submodules.columns = columns = LineMemory(shape=self._nearest, depth=self.max_features, loads=True)
        valid = delayed(m, valid, self._column_wait_cycles, reset_less=False)
        position = delayed(m, position, self._column_wait_cycles)
        first, last = lanes[0].i_bus, lanes[-1].o_bus
        read = delayed(m, position, RESULT_CYCLES)
        # Nothing clears the memory; the first group starts from empty columns, all ones, instead.
        empty = read.first_group.replicate(self._nearest.size)
        m.d.comb += [
            first.valid.eq(delayed(m, valid, COLUMN_CYCLES, reset_less=False)),
            first.position.eq(delayed(m, read, 1)),
            first.column.eq(delayed(m, Value.cast(columns.o_word) | empty, 1)),
            columns.i_read.eq(self.o_busy | self.i_read),
            columns.i_load.eq(columns.i_read),
            columns.i_read_address.eq(Mux(self.o_busy, position.right, self.i_column_index)),
            columns.i_write.eq(last.valid),
            columns.i_write_address.eq(last.position.right),
            columns.i_word.eq(last.column),
            self.o_column.eq(columns.o_word),
        ]

    def _hold_rows(self, m: Module, lanes: Sequence[Lane]) -> None:
        """Store the rows, which leave the lanes one after the other, in rising left index."""
        m.submodules.rows = rows = LineMemory(shape=self._nearest, depth=self.max_features, loads=True)
        valid = Signal()
        row = view_signal(self._nearest, reset_less=True)
        # The lanes finish one after the other, so at most one row is valid: OR is enough to select it.
        m.d.sync += [
            valid.eq(Cat(lane.o_row_valid for lane in lanes).any()),
            row.eq(reduce(or_, (Mux(lane.o_row_valid, lane.o_row.as_value(), 0) for lane in lanes))),
        ]
        with m.If(valid):
            m.d.sync += rows.i_write_address.eq(rows.i_write_address + 1)
        with m.If(self.i_start):
            m.d.sync += rows.i_write_address.eq(0)
        m.d.comb += [
            rows.i_write.eq(valid),
            rows.i_word.eq(row),
            rows.i_read.eq(self.i_read),
            rows.i_load.eq(self.i_read),
            rows.i_read_address.eq(self.i_row_index),
            self.o_row.eq(rows.o_word),
        ]
