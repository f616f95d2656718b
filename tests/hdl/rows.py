"""The test that every row runs through; the tables are the catalogue, and those of the folders."""

from collections.abc import Callable, Collection, Mapping
from typing import Any

import pytest
from amaranth import Module, Value
from amaranth.lib import data, wiring
from amaranth.lib.wiring import In, Out

from hdl.blocks.vectors import Block
from hdl.lib.delay import delayed
from sim.benches.rows import check

Rows = Mapping[str, Callable[[], Block]]


def row_test(table: Rows, *, slow: Collection[str] = ()) -> Callable[[Callable[[], Block]], None]:
    """Make the test of a table of rows."""
    rows = [pytest.param(make, id=name, marks=[pytest.mark.slow] * (name in slow)) for name, make in table.items()]

    @pytest.mark.parametrize("make", rows)
    def test_a_block_answers_as_the_golden_model(make: Callable[[], Block]) -> None:
        """With gaps and stalls, frame after frame, and after a reset in the middle of one."""
        check(make())

    return test_a_block_answers_as_the_golden_model


class Clocked(wiring.Component):
    """A block of plain ports and a fixed latency, with beats ``i`` and ``o`` that have a field for each of them."""

    i: data.View
    o: data.View

    def __init__(self, block: Any) -> None:
        self.block, self.latency_cycles = block, block.latency_cycles
        self._ports: dict[Any, dict[str, Any]] = {In: {}, Out: {}}
        shapes: dict[Any, dict[str, Any]] = {In: {"valid": 1}, Out: {"valid": 1}}
        for path, member, port in block.signature.flatten(block):
            name = "_".join(map(str, path))[2:] or "data"
            self._ports[member.flow][name], shapes[member.flow][name] = Value.cast(port), member.shape
        super().__init__({"i": In(data.StructLayout(shapes[In])), "o": Out(data.StructLayout(shapes[Out]))})

    def elaborate(self, platform: object) -> Module:
        m = Module()
        m.submodules.block = self.block
        given = {"valid": delayed(m, self.i.valid, self.latency_cycles, reset_less=False), **self._ports[Out]}
        m.d.comb += [port.eq(self.i[name]) for name, port in self._ports[In].items()]
        m.d.comb += [Value.cast(self.o[name]).eq(port) for name, port in given.items()]
        return m
