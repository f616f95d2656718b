"""The exported Verilog: which memories it clears, and which registers it marks.

Names of ports (`port_names`) are in the recorded Verilog of each block, and in `export/test_accelerator.py`.
"""

import re
import subprocess
import sys
from pathlib import Path

import pytest
from amaranth import Module, signed
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out

from hdl.lib.line_memory import LineMemory
from hdl.netlist import MAX_LOOP_WORDS, to_verilog
from hdl.shell.camera import CameraCrossing


@pytest.mark.parametrize(("words", "loops"), [(MAX_LOOP_WORDS, 1), (MAX_LOOP_WORDS + 1, 0)])
def test_a_memory_is_cleared_by_a_loop_that_tools_can_unroll(words: int, loops: int) -> None:
    verilog = to_verilog(LineMemory(shape=8, depth=words))
    assert f"[{words - 1}:0];" in verilog
    assert verilog.count("initial begin : clear_") == loops


def test_a_home_where_nobody_can_write_needs_no_other_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # As Wasmtime, which is the interpreter of Yosys, but with the usual cache: in an empty one it compiles for seconds.
    python = tmp_path / "python"
    python.write_text(
        "#!/bin/sh\n"
        f'case "$XDG_CACHE_HOME" in "{tmp_path}"*) echo "failed to create cache directory" >&2; exit 1; esac\n'
        f'unset XDG_CACHE_HOME; exec "{sys.executable}" "$@"\n'
    )
    python.chmod(0o700)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "unwritable"))
    monkeypatch.setattr(sys, "executable", str(python))
    assert "endmodule" in to_verilog(LineMemory(shape=8, depth=64), name="line")


def test_an_error_of_yosys_is_raised_at_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    python, starts = tmp_path / "python", tmp_path / "starts"
    python.write_text(
        f'#!/bin/sh\ncat > /dev/null; echo started >> "{starts}"; echo "ERROR: no such pass" >&2; exit 1\n'
    )
    python.chmod(0o700)
    monkeypatch.setattr(sys, "executable", str(python))
    with pytest.raises(subprocess.CalledProcessError) as failed:
        to_verilog(LineMemory(shape=8, depth=64))
    assert failed.value.stderr == "ERROR: no such pass\n"
    assert starts.read_text() == "started\n"


class _Sums(wiring.Component):
    """Operands that are narrower than the result, or than the other one."""

    a: In(3)
    b: In(6)
    c: In(signed(4))
    d: In(signed(6))
    total: Out(9)
    difference: Out(signed(9))
    less: Out(1)

    def elaborate(self, platform: object) -> Module:
        m = Module()
        m.d.comb += [self.total.eq(self.a + self.b), self.difference.eq(self.c - self.d), self.less.eq(self.a < self.b)]
        return m


@pytest.mark.parametrize(("aliases", "platform"), [(False, None), (True, None), (False, "ecp5")])
def test_operands_are_widened_where_linters_read(aliases: bool, platform: object) -> None:
    """What the tools of a known family read, and what has second names for waves, stays as it is."""
    verilog = re.sub(r"\(\*.*?\*\) ", "", to_verilog(_Sums(), aliases=aliases, platform=platform))
    found = re.findall(r" = (.* [-+<] .*);", verilog)
    if aliases or platform:
        assert found == ["a + b", "$signed(c) - $signed(d)", "a < b"]
    else:
        assert found == [
            "{ 4'h0, a } + { 1'h0, b }", "$signed({ c[3], c[3], c[3], c }) - $signed({ d[5], d })", "{ 3'h0, a } < b"
        ]  # fmt: skip


def test_the_stages_of_synchronisers_are_marked_and_nothing_else() -> None:
    verilog = to_verilog(CameraCrossing(video_bits=8, depth=32))
    # Two counters and a reset cross, over two stages each; the mark of a full output register, over four.
    assert len(re.findall(r'\(\* ASYNC_REG = "TRUE" \*\)\n  reg (?:\[\d+:0\] )?stage\d =', verilog)) == 10
    assert verilog.count("ASYNC_REG") == 10
