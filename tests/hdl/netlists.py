"""Netlists of Yosys's synthesis, simulated in Icarus or Verilator with Yosys's own models of the cells.

Yosys declares the vendors' block RAMs and multipliers without saying what they do. Their declarations, with all pins
and parameters, are completed here: with `block_ram.v`, and with `hdl/lib/ecp5_models.v`.
"""

from __future__ import annotations

import os
import re
import subprocess
from pathlib import Path
from typing import Any

from hdl.lib.ecp5 import MODELS, synthesis_commands
from sim.simulators import verilator
from tools.yosys import SHARE, YOSYS

BLOCK_RAM = Path(__file__).with_name("block_ram.v")
SYNTHESIS = {"xc7": "synth_xilinx -family xc7 -flatten -noiopad -noclkbuf -top {}".format, "ecp5": synthesis_commands}

# Words of twice a port's width take the pins of both: port A's have the lower half. Port B writes, port A reads.
XC7_RAM = """
  localparam SIDE = 9 * {bytes}, MODES = {{
    WRITE_MODE_B == "WRITE_FIRST" ? 2'd2 : WRITE_MODE_B == "READ_FIRST",
    WRITE_MODE_A == "WRITE_FIRST" ? 2'd2 : WRITE_MODE_A == "READ_FIRST"}};
  wire [143:0] q;
  wire [71:0] low, high;
  wire [71:0] answer_a = q[71:0];
  wire [71:0] answer_b = READ_WIDTH_A > SIDE ? answer_a >> SIDE : q[143:72];
  genvar n;
  generate for (n = 0; n < 8; n = n + 1) begin : lanes
    if (n < {bytes}) begin
      assign low[9*n+:9] = {{DIPADIP[n], DIADI[8*n+:8]}};
      assign high[9*n+:9] = {{DIPBDIP[n], DIBDI[8*n+:8]}};
      assign {{DOPADOP[n], DOADO[8*n+:8]}} = answer_a[9*n+:9];
      assign {{DOPBDOP[n], DOBDO[8*n+:8]}} = answer_b[9*n+:9];
    end else begin
      assign low[9*n+:9] = 0;
      assign high[9*n+:9] = 0;
    end
  end endgenerate
  block_ram #(.ADDRESS_BITS({address_bits}), .READ_BITS({{READ_WIDTH_B[7:0], READ_WIDTH_A[7:0]}}),
    .WRITE_BITS({{WRITE_WIDTH_B[7:0], WRITE_WIDTH_A[7:0]}}), .MODE(MODES), .HAS_REGISTER({{DOB_REG[0], DOA_REG[0]}})
  ) ram (
    .clock({{CLKBWRCLK, CLKARDCLK}}), .enable({{ENBWREN, ENARDEN}}),
    .reset({{RSTRAMB, RSTRAMARSTRAM}} & {{ENBWREN, ENARDEN}}),
    .register_enable({{REGCEB, REGCEAREGCE}}), .write({{8'd0 | WEBWE, 8'd0 | WEA}}),
    .address({{16'd0 | ADDRBWRADDR[{address_bits}-1:0], 16'd0 | ADDRARDADDR[{address_bits}-1:0]}}),
    .data({{WRITE_WIDTH_B > SIDE ? high << SIDE | low : high, low}}), .q(q));
  localparam [{rows}*256-1:0] CONTENT = {{{init}}};
  localparam [{rows}*32-1:0] NINTHS = {{{ninths}}};
  integer word;
  initial begin
    for (word = 0; word < {rows} * 32; word = word + 1) ram.bytes[word] = {{NINTHS[word], CONTENT[8*word+:8]}};
    if (IS_CLKARDCLK_INVERTED | IS_CLKBWRCLK_INVERTED | (|SRVAL_A === 1) | (|SRVAL_B === 1)) begin
      $display("block RAM: the model has rising clocks, and is cleared by a reset");
      $finish;
    end
  end
"""
ECP5_RAM = """
  localparam BITS_A = DATA_WIDTH_A, BITS_B = DATA_WIDTH_B;
  wire [17:0] low = {{{DIA}}}, high = {{{DIB}}};
  wire [13:0] place_a = {{{ADA}}}, place_b = {{{ADB}}};
  wire [143:0] q;
  // Of 36 bits port A writes and port B reads; the lower half is that of port A's pins.
  assign {{{DOA}}} = BITS_B == 36 ? q[89:72] : q[17:0];
  assign {{{DOB}}} = BITS_B == 36 ? q[107:90] : q[89:72];
  wire selects_a = {{CSA2, CSA1, CSA0}} == 0, selects_b = {{CSB2, CSB1, CSB0}} == 0;
  wire [7:0] write_a = WEA & selects_a ? (BITS_A == 36 ? place_a[3:0] : BITS_A == 18 ? place_a[1:0] : 1) : 0;
  wire [7:0] write_b = WEB & selects_b & BITS_B < 36 ? (BITS_B == 18 ? place_b[1:0] : 1) : 0;
  function [1:0] mode(input [127:0] name);
    mode = name == "WRITETHROUGH" ? 2 : name == "READBEFOREWRITE";
  endfunction
  block_ram #(.ADDRESS_BITS(14), .READ_BITS({{BITS_B[7:0], BITS_A[7:0]}}), .WRITE_BITS({{BITS_B[7:0], BITS_A[7:0]}}),
    .MODE({{mode(WRITEMODE_B), mode(WRITEMODE_A)}}), .HAS_REGISTER({{REGMODE_B == "OUTREG", REGMODE_A == "OUTREG"}})
  ) ram (
    .clock({{CLKB, CLKA}}), .enable({{CEB & selects_b, CEA & selects_a}}), .reset({{RSTB, RSTA}}),
    .register_enable({{OCEB, OCEA}}), .write({{write_b, write_a}}), .address({{2'd0, place_b, 2'd0, place_a}}),
    .data({{54'd0, high, 36'd0, high, low}}), .q(q));
  localparam [64*320-1:0] CONTENT = {{{init}}};
  integer word;
  initial for (word = 0; word < 2048; word = word + 1) ram.bytes[word] = CONTENT[20*(word/2)+9*(word%2)+:9];
"""


def models(folder: Path, family: str) -> list[Path]:
    """The models of a family's cells."""
    cells = folder / f"{family}_cells.v"
    if family == "xc7":
        text = (SHARE / "xilinx" / "cells_sim.v").read_text()
        for bytes_, address_bits, kind in ((2, 14, "RAMB18E1"), (4, 15, "RAMB36E1")):
            rows = 1 << (address_bits - 8)
            body = XC7_RAM.format(
                bytes=bytes_, address_bits=address_bits, rows=rows,
                init=_countdown("INIT_{:02X}", rows), ninths=_countdown("INITP_{:02X}", rows // 8),
            )  # fmt: skip
            text = _complete(text, kind, body)
        cells.write_text(text)
        return [cells, BLOCK_RAM]
    widths = {"DIA": 18, "DIB": 18, "ADA": 14, "ADB": 14, "DOA": 18, "DOB": 18}
    pins = {pin: _countdown(pin + "{}", bits) for pin, bits in widths.items()}
    body = ECP5_RAM.format(**pins, init=_countdown("INITVAL_{:02X}", 64))
    text = "".join((SHARE / "ecp5" / name).read_text() for name in ("common_sim.vh", "ccu2c_sim.vh", "cells_sim.v"))
    # Icarus 11 does not know `$error` outside of a process. No netlist has the cell before it is packed.
    text = re.sub(r"(?s)\nmodule TRELLIS_COMB\(.*?\nendmodule|`include \"c\w+_sim.vh\"", "", text)
    cells.write_text(_complete(text, "DP16KD", body))
    return [cells, MODELS, BLOCK_RAM]


def _countdown(name: str, count: int) -> str:
    return ", ".join(name.format(n) for n in reversed(range(count)))


def _complete(text: str, kind: str, body: str) -> str:
    """Put a body at the end of a module."""
    module = re.compile(rf"(?s)(\nmodule {kind} ?\(.*?\n)(endmodule)")
    completed, count = module.subn(lambda found: found[1] + body + found[2], text, count=1)
    assert count == 1, f"Yosys declares no {kind}"
    return completed


def synthesise(folder: Path, name: str, family: str, source: Path) -> Path:
    """Synthesise a module; the file of its netlist."""
    netlist = folder / f"{name}_{family}.v"
    script = f"read_verilog {source.name}; {SYNTHESIS[family](name)}; write_verilog -noattr {netlist.name}"
    _run([*YOSYS, "-q", "-p", script], cwd=folder)
    return netlist


def run_bench(folder: Path, name: str, sources: list[Path]) -> str:
    """Simulate the test bench of a module; what it prints."""
    options = ("-g2012", "-s", f"{name}_tb", "-DNO_INCLUDES", "-o", "bench")
    _run(["iverilog", *options, f"{name}_tb.v", *sources], cwd=folder)
    return subprocess.run(["vvp", "-n", "bench"], cwd=folder, capture_output=True, text=True, check=False).stdout


def run_compiled_bench(folder: Path, name: str, sources: list[Path]) -> str:
    """As `run_bench`, in Verilator: 0.1 s for a netlist of Harris that takes Icarus two minutes.

    Icarus follows every glitch of the carry chains. Verilator has no unknown bits, but random ones in their place.
    """
    runtime, objects = verilator.runtime_folder(), folder / "compiled"
    translated: list[str | Path] = [
        runtime.parent / "bin" / "verilator_bin",
        *("--cc", "--exe", "--main", "--timing", "--x-assign", "unique", "--x-initial", "unique"),
        *("-Wno-fatal", "-Wno-lint", "-Wno-style", "-DNO_INCLUDES", "--top-module", f"{name}_tb", "--Mdir", objects),
        f"{name}_tb.v",
        *sources,
    ]
    environment = {**os.environ, "VERILATOR_ROOT": str(runtime.parent)}
    _run(translated, cwd=folder, env=environment)
    parts = [*objects.glob("V*.cpp"), *(runtime / f"verilated{each}.cpp" for each in ("", "_threads", "_timing"))]
    whole = objects / "whole.cpp"
    whole.write_text("".join(f'#include "{part}"\n' for part in sorted(parts)))
    includes = (f"-I{objects}", *verilator.runtime_includes())
    # Without optimisation: the simulation takes seconds.
    options = ("-std=c++20", "-fcoroutines", "-O0", "-w", "-DVL_TIME_CONTEXT", "-pthread", *includes)
    _run(["g++", *options, whole, "-o", folder / "bench"], cwd=folder)
    seed = "+verilator+rand+reset+2"
    return subprocess.run([folder / "bench", seed], cwd=folder, capture_output=True, text=True, check=False).stdout


def _run(command: list[str | Path], **options: Any) -> None:
    # Verilator cuts long names within a character.
    done = subprocess.run(command, capture_output=True, text=True, errors="replace", check=False, **options)
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-2000:]
