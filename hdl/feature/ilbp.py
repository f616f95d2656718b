"""Ring descriptors of candidates, for any `golden_model.feature.ilbp.DescriptorPattern`."""

from collections.abc import Sequence

from amaranth import Cat, Const, Module, Mux, Signal, Value
from amaranth.lib.data import ArrayLayout, View
from amaranth.lib.wiring import In, Out

from golden_model.config import check_choice
from golden_model.feature.ilbp import DescriptorPattern
from hdl.feature.orientation import RingMoments, Sector
from hdl.lib.component import Component
from hdl.lib.delay import delayed
from hdl.lib.views import view_signal

Ring = Sequence[Value]
"""Pixels of a ring by angle."""


class RingDescriptor(Component):
    """Orientation sector and descriptor of each candidate.

    The rings of a candidate are copied and then rotated by a group of ``angles // spacing_cycles`` angles per clock.
    The ``spacing_cycles`` groups thus share the comparators and the adders of the orientation, the last group first.
    The comparison bits are delayed until the sector is known; it selects the position of each bit.

    Parameters
    ----------
    pattern : DescriptorPattern
        What is compared.
    spacing_cycles : {1, 2, 4}
        Smallest distance of two candidates in clocks: the time that one candidate may take.
    """

    i_candidate: In(1)
    """The pixels of the next clock belong to a candidate. One clock early, because this signal enables all ring
    registers."""
    i_pixels: Sequence[Sequence[Signal]]
    """Ring pixels by ring and angle, in the order of `DescriptorPattern.offsets`."""
    o_valid: Out(1)
    """``latency_cycles`` after ``i_candidate``, for one clock."""
    o_sector: Out(4)
    """0..15 sixteenths of a full circle."""
    o_descriptor: Signal
    """Bit 8 j + i is bit i of byte j."""

    def __init__(self, *, pattern: DescriptorPattern, spacing_cycles: int) -> None:
        check_choice("spacing_cycles", spacing_cycles, (1, 2, 4))
        self.pattern = pattern
        self.groups = spacing_cycles
        self.group_angles = pattern.angles // spacing_cycles
        self._wait_cycles = 0
        if pattern.oriented:
            self._moments = RingMoments(radii_px=pattern.radii_px, groups=self.groups)
            self._sector = Sector(moment=self._moments.o_mx.shape(), spacing_cycles=spacing_cycles)
            # Delay of the first group's comparisons (one clock) until the last group's moments have given the sector.
            self._wait_cycles = self.groups - 1 + self._moments.latency_cycles + self._sector.latency_cycles - 1
        # Early candidate, copy of the rings, first comparison, wait for the sector, collection of all groups.
        self.latency_cycles = 1 + 1 + 1 + self._wait_cycles + self.groups
        super().__init__(i_pixels=In(8).array(len(pattern.radii_px), pattern.angles), o_descriptor=Out(pattern.bits))

    def elaborate(self, platform: object) -> Module:
        """Rotate the rings, compare, find the sector, collect the bits."""
        m = Module()
        # age[n]: there was a candidate n + 1 clocks ago.
        age = Signal(self.latency_cycles)
        m.d.sync += age.eq(Cat(self.i_candidate, age))
        rotating = Signal()
        m.d.sync += rotating.eq(Cat(self.i_candidate, age)[: self.groups].any())
        rings = self._rotating_rings(m, age[0], rotating)
        arrived = delayed(m, rotating, 1, reset_less=False)
        columns = self._comparisons(m, rings, arrived)
        sector: Value = Const(0, 4)
        if self.pattern.oriented:
            self._connect_orientation(m, rings, arrived, age[1:])
            sector = self._sector.o_sector
        collection = age[2 + self._wait_cycles :][: self.groups]
        with m.If(collection[-1]):
            m.d.sync += self.o_sector.eq(sector)
        self._collect(m, delayed(m, columns, self._wait_cycles), sector, collection)
        m.d.comb += self.o_valid.eq(age[-1])
        return m

    def _rotating_rings(self, m: Module, load: Value, rotate: Value) -> list[Ring]:
        """Copy the candidate's rings and rotate them by one group per clock: the previous group comes to the front."""
        rings: list[Ring] = []
        for pixels, radius_px in zip(self.i_pixels, self.pattern.radii_px, strict=True):
            if radius_px == 0:
                # One pixel for all angles: one register, no rotation.
                centre = Signal(8, name="centre", reset_less=True)
                with m.If(load):
                    m.d.sync += centre.eq(pixels[0])
                rings.append([centre] * self.pattern.angles)
                continue
            # A register per group: compiled simulations rotate whole words, and no register reads itself.
            shape = ArrayLayout(8, self.group_angles)
            groups = [view_signal(shape, name=f"ring{radius_px}_{n}", reset_less=True) for n in range(self.groups)]
            for group, register in enumerate(groups):
                first = (group - 1) * self.group_angles
                following: Value = Cat(pixels[first + n] for n in range(self.group_angles))
                if self.groups > 1:
                    following = Mux(load, following, groups[group - 1].as_value())
                with m.If(rotate):
                    m.d.sync += register.eq(following)
            rings.append([register[n] for register in groups for n in range(self.group_angles)])
        return rings

    def _comparisons(self, m: Module, rings: list[Ring], arrived: Value) -> View:
        """Compare the group's pixels: one bit per descriptor byte and angle."""
        angles = self.pattern.angles
        columns = view_signal(ArrayLayout(len(self.pattern.comparisons), self.group_angles), reset_less=True)
        with m.If(arrived):
            for n in range(self.group_angles):
                bits = [rings[a][n] >= rings[b][(n + k) % angles] for a, b, k in self.pattern.comparisons]
                m.d.sync += columns[n].eq(Cat(bits))
        return columns

    def _connect_orientation(self, m: Module, rings: list[Ring], arrived: Value, age: Value) -> None:
        m.submodules.moments = moments = self._moments
        m.submodules.sector = sector = self._sector
        m.d.comb += [
            moments.i_valid.eq(arrived),
            moments.i_first.eq(age[0]),
            sector.i_valid.eq(age[self.groups - 1 + moments.latency_cycles]),
            sector.i_mx.eq(moments.o_mx),
            sector.i_my.eq(moments.o_my),
        ]
        for i_ring, ring in zip(moments.i_pixels, rings, strict=True):
            m.d.comb += [i_pixel.eq(ring[n]) for n, i_pixel in enumerate(i_ring)]

    def _collect(self, m: Module, columns: View, sector: Value, collection: Value) -> None:
        """Store bit i of every byte when the group of its angle, ``step * i + sector``, arrives."""
        step = self.pattern.angles // 8
        position_bits = (self.group_angles - 1).bit_length()
        bits = [Signal(len(self.pattern.comparisons), name=f"bit{i}", reset_less=True) for i in range(8)]
        for i, bit in enumerate(bits):
            angle = (sector + step * i)[: (self.pattern.angles - 1).bit_length()]
            position, group = angle[:position_bits], angle[position_bits:]
            # The last group comes first, hence the complement.
            with m.If(collection.bit_select(~group, 1) if self.groups > 1 else collection):
                m.d.sync += bit.eq(columns[position])
        m.d.comb += self.o_descriptor.eq(Cat(bit[j] for j in range(self.pattern.descriptor_bytes) for bit in bits))
