# amaranth: UnusedElaboratable=no
"""What Yosys makes of each block, for xc7 and for the ECP5, equals the golden model.

The blocks are those of `test_export`, for lines of 64 px; those for the ECP5 instantiate its multipliers and block
RAMs, as in `bench.synthesis`.
"""

from functools import partial
from pathlib import Path

import pytest

from bench.rules import largest_rules
from golden_model.config import MatcherConfig
from hdl.blocks import catalogue
from hdl.blocks.export import export_block
from hdl.blocks.flat import FlatBlock
from hdl.lib.ecp5 import Ecp5
from hdl.netlist import to_verilog
from tests.hdl.lib.test_ecp5 import raw_response
from tests.hdl.netlists import SYNTHESIS, models, run_bench, synthesise

pytestmark = pytest.mark.needs("icarus")
QUICK = {"raw_response": "xc7", "half": "ecp5"}
"""The others are slow tests."""
LOSES_AN_OPERAND = """
module square(input clk, input [15:0] a, d, output reg [33:0] p);
  wire [16:0] s = a + d;
  reg [16:0] x, y;
  reg [33:0] m;
  always @(posedge clk) begin
    x <= s; y <= s; m <= x * y; p <= m;
  end
endmodule
"""
"""Yosys 0.70 makes a DSP48E1 of it whose pre-adder adds and whose operand B is 0."""
SQUARE_BENCH = """
module square_tb;
  reg clk = 0;
  wire [33:0] p;
  always #5 clk = ~clk;
  square dut(.clk(clk), .a(16'd3), .d(16'd4), .p(p));
  initial #100 begin
    $display("%0d", p);
    $finish;
  end
endmodule
"""


@pytest.fixture(autouse=True)
def narrow(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(catalogue, "WIDTH_PX", 64)
    monkeypatch.setitem(catalogue.CATALOGUE, "raw_response", raw_response)


@pytest.mark.parametrize(
    ("name", "family"),
    [
        pytest.param(name, family, marks=[] if QUICK.get(name) == family else [pytest.mark.slow])
        for name in ("raw_response", *catalogue.CATALOGUE)
        for family in SYNTHESIS
    ],
)
def test_the_netlist_of_a_block_equals_the_golden_model(tmp_path: Path, name: str, family: str) -> None:
    export_block(tmp_path, name)
    source = tmp_path / f"{name}.v"
    if family == "ecp5":
        source.write_text(to_verilog(FlatBlock(catalogue.CATALOGUE[name]().component), name=name, platform=Ecp5()))
    netlist = synthesise(tmp_path, name, family, source)
    printed = run_bench(tmp_path, name, [netlist, *models(tmp_path, family)])
    assert printed.startswith("PASS"), printed


@pytest.mark.slow
@pytest.mark.parametrize("family", SYNTHESIS)
def test_the_netlist_of_the_matcher_with_own_rules_equals_the_golden_model(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, family: str
) -> None:
    block = partial(catalogue.matcher, MatcherConfig(rule_base=largest_rules()))
    monkeypatch.setitem(catalogue.CATALOGUE, "matcher", block)
    test_the_netlist_of_a_block_equals_the_golden_model(tmp_path, "matcher", family)


@pytest.mark.slow
def test_why_the_trace_has_a_register_before_the_multiplier(tmp_path: Path) -> None:
    """Fails once Yosys has mended it: then the register in `RawResponse` may go."""
    source = tmp_path / "square.v"
    source.write_text(LOSES_AN_OPERAND)
    (tmp_path / "square_tb.v").write_text(SQUARE_BENCH)
    netlist = synthesise(tmp_path, "square", "xc7", source)
    assert run_bench(tmp_path, "square", [source]) == "49\n"
    assert run_bench(tmp_path, "square", [netlist, *models(tmp_path, "xc7")]) == "0\n"
