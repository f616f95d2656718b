# amaranth: UnusedElaboratable=no
"""Structures become plain ports, named by their fields, and each port has its own bits."""

from typing import Any

import pytest
from amaranth.hdl import Fragment, signed, unsigned
from amaranth.lib import data, stream, wiring
from amaranth.lib.wiring import In, Out

from hdl.blocks.flat import FlatBlock, flat_values, leaves

NESTED = data.StructLayout(
    {"valid": 1, "pair": data.ArrayLayout(data.StructLayout({"x": 5, "y": signed(7)}), 2), "code": 3}
)


def test_leaves_are_named_by_their_path_and_follow_each_other() -> None:
    assert list(leaves("i", NESTED)) == [
        ("i_valid", 0, unsigned(1)),
        ("i_pair_0_x", 1, unsigned(5)),
        ("i_pair_0_y", 6, signed(7)),
        ("i_pair_1_x", 13, unsigned(5)),
        ("i_pair_1_y", 18, signed(7)),
        ("i_code", 25, unsigned(3)),
    ]
    assert list(leaves("i", 4)) == [("i", 0, unsigned(4))]


def test_values_get_the_bits_that_amaranth_gives_them() -> None:
    value: dict[int | str, Any] = {"valid": 1, "pair": [{"x": 17, "y": -3}, {"x": 2, "y": 40}], "code": 5}
    flat = flat_values("i", value)
    assert flat.keys() == {name for name, _, _ in leaves("i", NESTED)}
    bits = NESTED.const(value).as_bits()
    assert all(flat[name] & (1 << shape.width) - 1 == bits >> low & (1 << shape.width) - 1
        for name, low, shape in leaves("i", NESTED))  # fmt: skip


class Doubler(wiring.Component):
    """A stream of pairs, each doubled."""

    i: In(stream.Signature(data.StructLayout({"low": 4, "high": 4})))
    o: Out(stream.Signature(9))
    i_enable: In(1)

    def elaborate(self, platform: object) -> Fragment:
        return Fragment()


def test_a_block_has_a_port_for_each_field_and_its_handshake() -> None:
    block = FlatBlock(Doubler())
    Fragment.get(block, None)
    inputs = {name for name, member in block.signature.members.items() if member.flow is In}
    assert inputs == {"clk", "rst", "i_low", "i_high", "i_valid", "o_ready", "i_enable"}
    assert set(block.signature.members) - inputs == {"i_ready", "o", "o_valid"}


def test_a_member_without_bits_has_no_port() -> None:
    empty: wiring.Component = wiring.Component({"i": In(stream.Signature(unsigned(0))), "o": Out(unsigned(0))})
    assert set(FlatBlock(empty).signature.members) == {"clk", "rst", "i_valid", "i_ready"}


def test_two_ports_of_one_name_are_refused() -> None:
    both: wiring.Component = wiring.Component({"i": In(stream.Signature(unsigned(4))), "i_valid": In(1)})
    clocked: wiring.Component = wiring.Component({"clk": In(1)})
    for component, name in ((both, "i_valid"), (clocked, "clk")):
        with pytest.raises(ValueError, match=f"two ports would be called {name}; rename"):
            FlatBlock(component)
