"""Population counts of many lanes at once, by carry-save counters on bit planes."""

from collections.abc import Callable, Sequence
from typing import TypeVar

from amaranth import Cat, Module, Signal, Value
from amaranth.lib.wiring import In, Out

from golden_model.config import check_range
from hdl.lib.component import Component
from hdl.lib.delay import delayed

LAYERS_PER_STAGE = 2
"""Layers of counters between two registers, except before the first register: two levels of LUTs."""

Plane = TypeVar("Plane")
Columns = list[list[Plane]]
"""``columns[w]`` holds the planes of weight ``2**w`` that still have to be added."""


class Popcount(Component):
    """``o_counts[k]`` = number of ``i_planes`` with bit k set: one count per lane and clock.

    A plane holds one bit of every lane, side by side. Counters replace six planes of one weight by three of rising
    weight (or three by two), with one LUT per output bit and lane, until at most two planes of each weight are left;
    then one adder per lane gives the count. The netlist is the same as for separate lanes, but a simulator evaluates
    all lanes in one word operation.

    Parameters
    ----------
    bits : int
        Planes to count, at least 3.
    lanes : int
        Width of a plane.
    """

    i_valid: In(1)
    """The planes are valid. Stages without valid data keep their value, which saves power and simulation time."""
    i_planes: Sequence[Signal]
    """``bits`` planes of ``lanes`` bits."""
    o_counts: Sequence[Signal]
    """A count for each lane."""

    def __init__(self, *, bits: int, lanes: int) -> None:
        check_range("bits", bits, 3)
        # The layers are counted without hardware: the latency has to be known before elaboration.
        columns = add_layer([[None] * bits], _count_bits, largest=3)
        self.latency_cycles = 2
        while _max_height(columns) > 2:
            columns = _stage(columns, _count_bits)
            self.latency_cycles += 1
        super().__init__(i_planes=In(lanes).array(bits), o_counts=Out(range(bits + 1)).array(lanes))

    def elaborate(self, platform: object) -> Module:
        """Layers of counters between registers, then the adders."""
        m = Module()

        def counter(planes: list[Value]) -> list[Value]:
            return _sum6(m, planes) if len(planes) == 6 else _full_adder(m, *planes)

        # The first layer counts triples only, so that the XOR of the descriptors in front of it fits the same LUTs.
        valid, columns = self._register(m, self.i_valid, add_layer([list(self.i_planes)], counter, largest=3))
        while _max_height(columns) > 2:
            valid, columns = self._register(m, valid, _stage(columns, counter))
        # Columns of at most two planes are left: the two rows of an ordinary addition in each lane.
        for lane, count in enumerate(self.o_counts):
            first = Cat(column[0][lane] for column in columns)
            second = Cat(column[1][lane] if len(column) > 1 else 0 for column in columns)
            register = Signal.like(count, name=f"count{lane}", reset_less=True)
            with m.If(valid):
                m.d.sync += register.eq(first + second)
            m.d.comb += count.eq(register)
        return m

    @staticmethod
    def _register(m: Module, valid: Value, columns: Columns[Value]) -> tuple[Value, Columns[Value]]:
        registers: Columns[Value] = [
            [Signal.like(plane, name="plane", reset_less=True) for plane in column] for column in columns
        ]
        with m.If(valid):
            for column, register in zip(columns, registers, strict=True):
                m.d.sync += [q.eq(plane) for plane, q in zip(column, register, strict=True)]
        return delayed(m, valid, 1, reset_less=False), registers


def add_layer(
    columns: Columns[Plane], counter: Callable[[list[Plane]], list[Plane]], *, largest: int = 6
) -> Columns[Plane]:
    """Add a layer of carry-save counters: groups of ``largest`` planes of one weight first, then groups of 3.

    ``counter`` takes a group and returns the bits of its sum, lowest weight first. The remaining planes pass unchanged.
    """
    result: Columns[Plane] = [[] for _ in range(len(columns) + 2)]
    for weight, column in enumerate(columns):
        position = 0
        for size in (largest, 3):
            while position + size <= len(column):
                for k, plane in enumerate(counter(column[position : position + size])):
                    result[weight + k].append(plane)
                position += size
        result[weight] += column[position:]
    return [column for column in result if column]


def _stage(columns: Columns[Plane], counter: Callable[[list[Plane]], list[Plane]]) -> Columns[Plane]:
    for _ in range(LAYERS_PER_STAGE):
        columns = add_layer(columns, counter)
    return columns


def _max_height(columns: Columns[Plane]) -> int:
    return max(len(column) for column in columns)


def _count_bits(planes: list[None]) -> list[None]:
    """Stand-in for a counter where only the number of planes matters: to compute the latency."""
    return [None] * len(planes).bit_length()


def _full_adder(m: Module, a: Value, b: Value, c: Value) -> list[Value]:
    total = Signal.like(a, name="total")
    carry = Signal.like(a, name="carry")
    m.d.comb += [total.eq(a ^ b ^ c), carry.eq((a & b) | (c & (a ^ b)))]
    return [total, carry]


def _sum6(m: Module, planes: list[Value]) -> list[Value]:
    # Each of the three result bits is a function of six inputs: one 6-input LUT.
    (low_a, high_a), (low_b, high_b) = _full_adder(m, *planes[:3]), _full_adder(m, *planes[3:])
    ones = Signal.like(low_a, name="ones")
    carry = Signal.like(low_a, name="low_carry")
    m.d.comb += [ones.eq(low_a ^ low_b), carry.eq(low_a & low_b)]
    return [ones, *_full_adder(m, high_a, high_b, carry)]
