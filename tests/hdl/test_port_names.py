"""Ports that Amaranth numbers get the names of the signals that they carry; the netlist is read for them."""

import re

from amaranth import Cat, Module, Signal
from amaranth.back import rtlil
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out

from hdl.port_names import name_ports


class _Inner(wiring.Component):
    """Its input is made of parts of other signals, so that no signal in it has exactly the bits of its ports."""

    i: In(6)
    o: Out(6)

    def elaborate(self, platform: object) -> Module:
        m = Module()
        m.d.sync += self.o.eq(self.i ^ self.o)
        return m


class _Top(wiring.Component):
    i: In(8)
    o: Out(6)

    def elaborate(self, platform: object) -> Module:
        m = Module()
        word, second = Signal(8, name="word"), Signal(8, name="second")
        m.d.sync += [word.eq(self.i), second.eq(word + second)]
        m.submodules.inner = inner = _Inner()
        m.d.comb += [inner.i.eq(Cat(word[2:5], second[3:6])), self.o.eq(inner.o)]
        return m


def ports_of(netlist: str, module: str) -> set[str]:
    (text,) = re.findall(rf"^module \\{module}$.*?^end$", netlist, re.M | re.S)
    return set(re.findall(r"^  wire width \d+ (?:input|output) \d+ +\\(\S+)$", text, re.M))


def test_a_part_of_a_signal_is_called_after_it_and_its_lowest_bit() -> None:
    assert "port$" in rtlil.convert(_Top(), emit_src=False)
    with name_ports():
        netlist = rtlil.convert(_Top(), emit_src=False)
    assert "port$" not in netlist
    # The lower half is the lowest in `i` of the module itself, whose name is taken.
    assert ports_of(netlist, r"top\.inner") == {"clk", "rst", "o", "i_", "second_3"}
    # Only for the time of a conversion.
    assert "port$" in rtlil.convert(_Top(), emit_src=False)
