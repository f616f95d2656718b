"""A bench has its streams' ports in one word, and compares only what is specified."""

from hdl.blocks.testbench import Port, VerilogBench

PORTS = {
    "clk": Port(1, True),
    "rst": Port(1, True),
    "i_low": Port(4, True),
    "i_high": Port(6, True),
    "i_valid": Port(1, True),
    "i_ready": Port(1, False),
    "i_mode": Port(2, True),
    "o_sum": Port(7, False),
    "o_carry": Port(1, False),
    "o_valid": Port(1, False),
}
BENCH = VerilogBench(
    module="adder",
    ports=PORTS,
    inputs={"i_": [{"i_low": 3, "i_high": 33}, {"i_low": -1}]},
    outputs={"o_": [{"o_sum": 36}, {"o_sum": 5, "o_carry": 1}]},
    settings={"i_mode": 2},
)


def test_rows_become_words_with_the_last_field_lowest() -> None:
    files = BENCH.files()
    # 10 bits: low above high; a negative value is cut to its field.
    assert files["i.hex"].split() == [f"{3 << 6 | 33:03x}", f"{15 << 6:03x}"]
    assert files["o.hex"].split() == [f"{36 << 1:02x}", f"{5 << 1 | 1:02x}"]


def test_what_a_row_leaves_out_is_not_compared() -> None:
    assert BENCH.files()["o_specified.hex"].split() == [f"{127 << 1:02x}", "ff"]


def test_a_setting_is_no_field_and_stays() -> None:
    verilog = BENCH.files()["adder_tb.v"]
    assert "i_mode = 2" in verilog
    assert "{i_low, i_high}" in verilog
    assert "o_ready" not in verilog
    assert "i_ready" in verilog
