"""The exported Verilog: which memories it clears."""

import pytest

from hdl.lib.line_memory import LineMemory
from hdl.netlist import MAX_LOOP_WORDS, to_verilog


@pytest.mark.parametrize(("words", "loops"), [(MAX_LOOP_WORDS, 1), (MAX_LOOP_WORDS + 1, 0)])
def test_a_memory_is_cleared_by_a_loop_that_tools_can_unroll(words: int, loops: int) -> None:
    verilog = to_verilog(LineMemory(shape=8, depth=words))
    assert f"[{words - 1}:0];" in verilog
    assert verilog.count("initial begin : clear_") == loops
