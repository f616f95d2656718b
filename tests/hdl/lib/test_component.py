"""Ports come from annotations and arguments, in the order of the annotations."""

from typing import Any

import pytest
from amaranth import Module, Signal
from amaranth.back.rtlil import convert
from amaranth.lib.wiring import In, Out

from hdl.lib.component import Component


class Sum(Component):
    i_a: Signal
    i_enable: In(1)
    o: Signal
    bits: int

    def __init__(self, *, bits: int) -> None:
        self.bits = bits
        super().__init__(i_b=In(bits), o=Out(bits + 1), i_a=In(bits))

    def elaborate(self, platform: object) -> Module:
        m = Module()
        m.d.comb += self.o.eq((self.i_a + self.i_b) & self.i_enable.replicate(self.bits + 1))
        return m


class Difference(Sum):
    """What it computes is not looked at."""


@pytest.mark.usefixtures("unused_blocks")
@pytest.mark.parametrize("block", [Sum, Difference])
def test_a_component_and_its_subclass_have_ports_of_both_kinds(block: Any) -> None:
    dut = block(bits=4)
    shapes = {name: (member.flow, member.shape) for name, member in dut.signature.members.items()}
    assert shapes == {"i_a": (In, 4), "i_enable": (In, 1), "o": (Out, 5), "i_b": (In, 4)}
    assert list(shapes) == ["i_a", "i_enable", "o", "i_b"]


def test_the_source_of_a_port_is_the_component_not_its_base() -> None:
    assert "hdl/lib/component.py" not in convert(Sum(bits=4), name="top")
