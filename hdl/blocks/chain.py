"""Compositions for export: blocks in series, and the descriptor with pixels and result in simple streams."""

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any

from amaranth import Cat, Module
from amaranth.lib import data, wiring
from amaranth.lib.wiring import In, Out

from golden_model.feature.ilbp import DescriptorPattern
from hdl.feature.ilbp import RingDescriptor
from hdl.lib.component import Component
from hdl.lib.delay import delayed
from hdl.streams import carry_scan


class Chain(wiring.Component):
    """Blocks with beats at ``i`` and ``o``, one after the other; their other inputs become ports.

    Parameters
    ----------
    blocks : mapping of str to Component
        The blocks, by name of their submodules.
    lag_px : int
        Lag of the whole chain.
    fields : mapping of str to str, optional
        Input fields that the preceding block lacks, each with the field of that block to connect instead.
    constants : mapping of str to int, optional
        Inputs tied to a value, which get no port.
    """

    i: data.View
    o: data.View

    def __init__(
        self,
        blocks: Mapping[str, Any],
        *,
        lag_px: int,
        fields: Mapping[str, str] | None = None,
        constants: Mapping[str, int] | None = None,
    ) -> None:
        self.blocks = dict(blocks)
        self.lag_px = lag_px
        self._fields = fields or {}
        self._constants = dict(constants or {})
        first, *_, last = self.blocks.values()
        self.pixels_per_clock = getattr(first, "pixels_per_clock", 1)
        self._settings = {
            name: member.shape
            for block in self.blocks.values()
            for name, member in block.signature.members.items()
            if name not in {"i", "o", *self._constants} and member.flow == In
        }
        super().__init__(
            {
                "i": In(first.signature.members["i"].shape),
                **{name: In(shape) for name, shape in self._settings.items()},
                "o": Out(last.signature.members["o"].shape),
            }
        )

    def elaborate(self, platform: object) -> Module:
        """Connect each block to the next, and the settings to all."""
        m = Module()
        blocks: Sequence[Any] = list(self.blocks.values())
        values = {name: getattr(self, name) for name in self._settings} | self._constants
        for name, block in self.blocks.items():
            m.submodules[name] = block
            inputs = values.keys() & block.signature.members.keys()
            m.d.comb += [getattr(block, each).eq(values[each]) for each in sorted(inputs)]
        m.d.comb += [blocks[0].i.eq(self.i), self.o.eq(blocks[-1].o)]
        for before, after in pairwise(blocks):
            # Beats have different payloads: fields are connected by name.
            carry_scan(m, before.o, after.i, 0)
            names = [str(name) for name, _ in after.i.shape() if name not in ("valid", "x", "y")]
            outputs = {name for name, _ in before.o.shape()}
            m.d.comb += [after.i[name].eq(before.o[name if name in outputs else self._fields[name]]) for name in names]
        return m


class Descriptor(Component):
    """`RingDescriptor` that takes a candidate's pixels together with its valid bit.

    Candidates come at least ``spacing_cycles`` apart.
    """

    i: data.View
    """``valid``, and the pixels of each ring (`DescriptorPattern.offsets`)."""
    o: data.View
    """``valid``, ``sector`` and ``descriptor``, of which bit 8 j + i is bit i of byte j."""

    def __init__(self, *, pattern: DescriptorPattern, spacing_cycles: int = 4) -> None:
        self.spacing_cycles = spacing_cycles
        self._block = RingDescriptor(pattern=pattern, spacing_cycles=spacing_cycles)
        self.latency_cycles = self._block.latency_cycles
        rings = data.ArrayLayout(data.ArrayLayout(8, pattern.angles), len(pattern.radii_px))
        result = data.StructLayout({"valid": 1, "sector": 4, "descriptor": pattern.bits})
        super().__init__(i=In(data.StructLayout({"valid": 1, "rings": rings})), o=Out(result))

    def elaborate(self, platform: object) -> Module:
        """Delay the pixels for the block."""
        m = Module()
        m.submodules.block = block = self._block
        # The block needs `i_candidate` one clock before the pixels.
        rings = delayed(m, self.i.rings, 1)
        m.d.comb += [
            block.i_candidate.eq(self.i.valid),
            self.o.valid.eq(block.o_valid),
            self.o.sector.eq(block.o_sector),
            self.o.descriptor.eq(block.o_descriptor),
            Cat(block.i_pixels).eq(rings),
        ]
        return m
