"""Blocks in series behave as one, and have the ports that are left."""

import pytest
from amaranth.hdl import Fragment

from hdl.blocks.chain import Chain
from hdl.pixel.fast import WINDOW_PX, Fast
from hdl.pixel.window import LineBuffer


@pytest.mark.parametrize(
    ("constants", "ports"), [({}, {"i", "o", "i_threshold_code"}), ({"i_threshold_code": 9}, {"i", "o"})]
)
def test_inputs_besides_the_beats_are_ports_unless_they_are_constant(
    constants: dict[str, int], ports: set[str]
) -> None:
    lines = LineBuffer(shape=8, lines=WINDOW_PX - 1, width_px=64)
    chain = Chain({"lines": lines, "block": Fast()}, lag_px=3, constants=constants)
    Fragment.get(chain, None)
    assert set(chain.signature.members) == ports
    assert chain.lag_px == 3
