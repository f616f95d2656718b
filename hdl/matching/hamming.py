"""A chain of lanes that right descriptors pass through: Hamming distances, and the nearest of each row and column."""

from collections.abc import Sequence

from amaranth import Cat, Const, Module, Mux, Signal
from amaranth.lib import data
from amaranth.lib.wiring import In, Out

from hdl.lib.component import Component
from hdl.lib.delay import delayed, port_register
from hdl.lib.popcount import Popcount


class Distances(Component):
    """Hamming distances in a chain of lanes: each lane holds a left descriptor, right ones advance one lane per clock.

    Lane k sees a right descriptor k clocks after lane 0. Descriptors are stored as bit planes: one signal for bit n of
    all lanes (`Popcount`).

    Parameters
    ----------
    bits : int
        Length of a descriptor.
    lanes : int
    """

    i_run: In(1)
    """High from the first right descriptor until the last one has left the lanes; the lanes hold otherwise."""
    i_valid: In(1)
    i_right: Signal
    """A right descriptor for lane 0, where ``i_valid``; it should not change otherwise."""
    i_load: In(1)
    i_lane: Signal
    i_left: Signal
    i_left_valid: In(1)
    """With ``i_load``, lane ``i_lane`` takes ``i_left`` for the right descriptor that
    reaches it in this clock, and later ones; without ``i_left_valid`` the lane gives no distances until its next
    load."""
    o_valid: Signal
    """Which lanes have a distance in this clock."""
    o_distances: Sequence[Signal]
    """Distance of each lane, 0 to ``bits``."""

    latency_cycles: int
    """Clocks from the inputs to lane 0's distance."""

    def __init__(self, *, bits: int, lanes: int) -> None:
        self.lanes = lanes
        self._popcount = Popcount(bits=bits, lanes=lanes)
        self.latency_cycles = 1 + self._popcount.latency_cycles
        super().__init__(
            i_right=In(bits),
            i_lane=In(range(lanes)),
            i_left=In(bits),
            o_valid=Out(lanes),
            o_distances=Out(range(bits + 1)).array(lanes),
        )

    def elaborate(self, platform: object) -> Module:
        """Operand registers, exclusive or, count."""
        m = Module()
        m.submodules.popcount = popcount = self._popcount
        # One bit per lane; a lane without a left descriptor takes no part.
        left_valid = Signal(self.lanes)
        right_valid = Signal(self.lanes)
        entered = Signal(self.lanes)
        counting = Signal()
        # The counters rest while no right descriptor is in the chain.
        m.d.comb += [entered.eq(Cat(self.i_valid, right_valid[:-1])), popcount.i_valid.eq(counting)]
        m.d.sync += [right_valid.eq(entered), counting.eq(entered.any())]
        with m.If(self.i_load):
            m.d.sync += left_valid.bit_select(self.i_lane, 1).eq(self.i_left_valid)
        # Plane n holds bit n of every lane: shifting it by one moves each right descriptor to the next lane.
        for n, unequal in enumerate(popcount.i_planes):
            left = Signal(self.lanes, name=f"left{n}", reset_less=True)
            right = Signal(self.lanes, name=f"right{n}", reset_less=True)
            with m.If(self.i_run):
                m.d.sync += right.eq(Cat(self.i_right[n], right[:-1]))
            with m.If(self.i_load):
                m.d.sync += left.bit_select(self.i_lane, 1).eq(self.i_left[n])
            m.d.comb += unequal.eq(left ^ right)
        valid = delayed(m, left_valid & right_valid, popcount.latency_cycles, reset_less=False)
        m.d.comb += [self.o_valid.eq(valid), Cat(self.o_distances).eq(Cat(popcount.o_counts))]
        return m


def nearest_layout(*, bits: int, max_features: int) -> data.StructLayout:
    """The nearest neighbour of a row or column so far: its distance and index, and the second smallest distance.

    All ones means none, as every distance is smaller; a missing second neighbour reads as all ones.
    """
    return data.StructLayout({"best": range(bits + 1), "second": range(bits + 1), "index": range(max_features)})


def position_layout(*, lanes: int, max_features: int) -> data.StructLayout:
    """Progress of a search.

    ``group`` counts the loads of the lanes, ``first_group`` marks the first; ``right`` is the index of the right
    descriptor, ``first`` and ``last`` mark the first and last one of the pass.
    """
    group = range(-(-max_features // lanes))
    return data.StructLayout({"first_group": 1, "group": group, "first": 1, "last": 1, "right": range(max_features)})


def bus_layout(*, bits: int, lanes: int, max_features: int) -> data.StructLayout:
    """Accompanies a right descriptor from lane to lane: its position, and the nearest left descriptor so far."""
    position = position_layout(lanes=lanes, max_features=max_features)
    return data.StructLayout(
        {"valid": 1, "position": position, "column": nearest_layout(bits=bits, max_features=max_features)}
    )


class Lane(Component):
    """Nearest right descriptor of one left descriptor; also updates the column of each passing right descriptor.

    Parameters
    ----------
    lane, lanes : int
        Number of this lane, and how many there are, a power of two: the left index is ``lanes * group + lane``.
    bits, max_features : int
    """

    i_valid: In(1)
    i_distance: Signal
    """Distance to the right descriptor of ``i_bus``, where ``i_valid``."""
    i_bus: data.View
    """`bus_layout` from the previous lane."""
    o_bus: data.View
    """`bus_layout` to the next lane, one clock later."""
    o_row_valid: Out(1)
    o_row: data.View
    """The finished row, one clock after its last right descriptor."""

    def __init__(self, *, lane: int, lanes: int, bits: int, max_features: int) -> None:
        self.lane = Const(lane, range(lanes))
        bus = bus_layout(bits=bits, lanes=lanes, max_features=max_features)
        super().__init__(
            i_distance=In(range(bits + 1)),
            i_bus=In(bus),
            o_bus=Out(bus),
            o_row=Out(nearest_layout(bits=bits, max_features=max_features)),
        )

    def elaborate(self, platform: object) -> Module:
        """Only a strictly smaller distance replaces the best: both indices rise, so ties go to the lowest."""
        m = Module()
        distance, position, column = self.i_distance, self.i_bus.position, self.i_bus.column
        row = port_register(m, self.o_row)
        next_position = port_register(m, self.o_bus.position)
        next_column = port_register(m, self.o_bus.column)
        m.d.sync += [self.o_row_valid.eq(self.i_valid & position.last), self.o_bus.valid.eq(self.i_bus.valid)]
        with m.If(self.i_valid):
            with m.If(position.first | (distance < row.best)):
                m.d.sync += [row.best.eq(distance), row.index.eq(position.right)]
                # The row still holds the last group's result: its second must not become this group's.
                m.d.sync += row.second.eq(Mux(position.first, ~0, row.best))
            with m.Elif(distance < row.second):
                m.d.sync += row.second.eq(distance)
        with m.If(self.i_bus.valid):
            m.d.sync += [next_position.eq(position), next_column.eq(column)]
            with m.If(self.i_valid & (distance < column.best)):
                m.d.sync += [next_column.best.eq(distance), next_column.second.eq(column.best)]
                m.d.sync += next_column.index.eq(Cat(self.lane, position.group))
            with m.Elif(self.i_valid & (distance < column.second)):
                m.d.sync += next_column.second.eq(distance)
        return m
