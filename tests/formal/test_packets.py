"""The accelerator's ways out: whole packets or none, and no word lost, doubled or withdrawn."""

from pathlib import Path

from amaranth import Cat, Elaboratable, Module, Signal, Value, unsigned
from amaranth.hdl import Assert, Assume, Cover
from amaranth.lib import stream, wiring
from amaranth.lib.wiring import In, Out

from golden_model.records import WORD_BYTES
from hdl.accelerator import Accelerator
from hdl.axi.packet_gate import PacketGate
from hdl.lib.skid_buffer import SkidBuffer
from tests.formal.proofs import StreamContract, held, prove

RECORD_WORDS = 4


class _Gate(Elaboratable):
    """While the switch does anything, packets go through or are discarded as it stood before their first word."""

    def __init__(self) -> None:
        self.gate = PacketGate(record_bytes=RECORD_WORDS * WORD_BYTES)
        i, o = self.gate.i, self.gate.o
        # All bits of a word go the same way: two of them tell where.
        self.bits, self.last = Signal(2), Signal()
        self.ports = [self.bits, self.last, i.valid, o.ready, self.gate.i_enable]

    def elaborate(self, platform: object) -> Module:
        m = Module()
        m.submodules.gate = gate = self.gate
        i, o = gate.i, gate.o
        m.d.comb += [Cat(i.payload.data[0], i.payload.data[-1]).eq(self.bits), i.payload.last.eq(self.last)]
        held(m, Assume, i.valid, i.ready, Value.cast(i.payload))
        held(m, Assert, o.valid, o.ready, Value.cast(o.payload))
        word = Signal(range(RECORD_WORDS))
        taken, given = i.valid & i.ready, o.valid & o.ready
        ends = taken & i.payload.last
        with m.If(i.payload.last):
            m.d.comb += Assume(word == RECORD_WORDS - 1)
        with m.If(taken):
            m.d.sync += word.eq(word + 1)

        # The switch as it stood when the packet was first seen.
        seen, passes = Signal(), Signal()
        with m.If(ends):
            m.d.sync += seen.eq(0)
        with m.Elif(i.valid & ~seen):
            m.d.sync += [seen.eq(1), passes.eq(gate.i_enable)]
        m.d.comb += Assert(given == (taken & passes))
        with m.If(taken):
            m.d.comb += Assert(seen)
        with m.If(given):
            m.d.comb += Assert(Value.cast(o.payload) == Value.cast(i.payload))

        ended, record = Signal(), Signal((RECORD_WORDS - 1) * 8 * WORD_BYTES)
        m.d.sync += ended.eq(ends)
        with m.If(taken & (word < RECORD_WORDS - 1)):
            m.d.sync += record.eq(Cat(record, i.payload.data)[8 * WORD_BYTES :])
        m.d.comb += Assert(gate.o_done == ended)
        with m.If(gate.o_done):
            m.d.comb += Assert(Value.cast(gate.o_status) == record)

        let_through, discarded = Signal(2), Signal(2)
        with m.If(ends):
            m.d.sync += [let_through.eq(let_through + passes), discarded.eq(discarded + ~passes)]
        m.d.comb += [Cover((let_through == 1) & (discarded == 1)), Cover(ends & passes & ~gate.i_enable)]
        return m


def test_a_gate_passes_whole_packets_or_none(tmp_path: Path) -> None:
    prove(_Gate(), tmp_path)


class _Branches(wiring.Component):
    """The accelerator's fork of features: ``o`` is one of the ways, the other one takes what it likes."""

    def __init__(self) -> None:
        words = stream.Signature(unsigned(2))
        super().__init__({"i": In(words), "o": Out(words), "other": Out(words)})

    def elaborate(self, platform: object) -> Module:
        m = Module()
        m.submodules.one = one = SkidBuffer(shape=unsigned(2))
        m.submodules.two = two = SkidBuffer(shape=unsigned(2))
        wiring.connect(m, one.o, wiring.flipped(self.o))
        wiring.connect(m, two.o, wiring.flipped(self.other))
        Accelerator._fork(m, wiring.flipped(self.i), one.i, two.i)
        return m


def test_each_way_of_the_fork_gets_every_word_once(tmp_path: Path) -> None:
    branches = _Branches()
    prove(StreamContract(branches, depth=2, free=[branches.other.ready]), tmp_path)
