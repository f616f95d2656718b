"""The accelerator's ways out: whole packets or none, and no word lost, doubled or withdrawn."""

from pathlib import Path

from amaranth import Cat, Elaboratable, Module, Signal, Value, unsigned
from amaranth.hdl import Assert, Assume, Cover
from amaranth.lib import stream, wiring
from amaranth.lib.wiring import In, Out

from golden_model.records import WORD_BYTES, Cause, Tag
from hdl.axi.packet_gate import PacketGate
from hdl.lib.skid_buffer import SkidBuffer
from hdl.streams import fork
from tests.formal.proofs import StreamContract, happened, held, prove

RECORD_WORDS = 4


class _Gate(Elaboratable):
    """While the switch does anything, packets go through or are discarded as it stood before their first word."""

    def __init__(self) -> None:
        self.gate = PacketGate(record_bytes=RECORD_WORDS * WORD_BYTES)
        # All bits of a word go the same way: two of them tell where.
        self.bits, self.last = Signal(2), Signal()
        self.ports = [self.bits, self.last, self.gate.i.valid, self.gate.o.ready, self.gate.i_enable]

    def elaborate(self, platform: object) -> Module:
        m = Module()
        m.submodules.gate = gate = self.gate
        source, i, o = gate.i, gate.buffer.o, gate.o
        watched = Cat(source.payload.data[0], source.payload.data[-1])
        m.d.comb += [watched.eq(self.bits), source.payload.last.eq(self.last)]
        held(m, Assume, source.valid, source.ready, Value.cast(source.payload))
        held(m, Assert, o.valid, o.ready, Value.cast(o.payload))
        sent, word = Signal(range(RECORD_WORDS)), Signal(range(RECORD_WORDS))
        with m.If(source.payload.last):
            m.d.comb += Assume(sent == RECORD_WORDS - 1)
        with m.If(source.valid & source.ready):
            m.d.sync += sent.eq(sent + 1)
        taken, given = i.valid & i.ready, o.valid & o.ready
        ends = taken & i.payload.last
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

        let_through, discarded = (happened(m, ends & value, most=2) for value in (passes, ~passes))
        m.d.comb += [Cover((let_through == 1) & (discarded == 1)), Cover(ends & passes & ~gate.i_enable)]
        return m


class _Cleared(Elaboratable):
    """While ``i_clear`` breaks packets off at any time, what leaves keeps the rules of AXI4-Stream and ends.

    The lowest bit of a word tells on which side of a clear it came in, the highest whether it is a packet's last.
    """

    def __init__(self) -> None:
        self.gate = PacketGate(record_bytes=RECORD_WORDS * WORD_BYTES)
        self.last = Signal()
        self.ports = [self.gate.i.valid, self.last, self.gate.o.ready, self.gate.i_enable, self.gate.i_clear]

    def elaborate(self, platform: object) -> Module:
        m = Module()
        m.submodules.gate = gate = self.gate
        i, o, clear = gate.i, gate.o, gate.i_clear
        side, sent, last = Signal(), Signal(range(RECORD_WORDS)), self.last
        m.d.comb += [
            i.payload.data[0].eq(side),
            i.payload.data[-1].eq(last),
            i.payload.last.eq(last),
            Assume(~last | (sent == RECORD_WORDS - 1)),
        ]
        # A clear breaks off what waits at the input, too.
        waited, waited_last = Signal(), Signal()
        m.d.sync += [waited.eq(i.valid & ~i.ready & ~clear), waited_last.eq(last)]
        with m.If(waited):
            m.d.comb += Assume(i.valid & (last == waited_last))
        with m.If(clear):
            m.d.sync += [sent.eq(0), side.eq(~side)]
        with m.Elif(i.valid & i.ready):
            m.d.sync += sent.eq(sent + 1)
        held(m, Assert, o.valid, o.ready, Value.cast(o.payload))
        self._packets(m, side)
        return m

    def _packets(self, m: Module, side: Signal) -> None:
        """Whole records of one side of a clear, and a FrameStatus of the source's, or one that says it was cleared."""
        gate, o = self.gate, self.gate.o
        given, data = o.valid & o.ready, o.payload.data
        word, status, of_side, broken, begun = Signal(range(RECORD_WORDS)), Signal(), Signal(), Signal(), Signal()
        of_source = data[-1]
        first, causes = (word == 0) & (data[:8] == Tag.FRAME_STATUS), data[16:32]
        with m.If(given):
            m.d.sync += [word.eq(word + 1), begun.eq(~o.payload.last)]
            with m.If(word == 0):
                m.d.sync += status.eq(first)
            with m.If(first):
                m.d.comb += Assert(~data[8] & (causes == Cause.CLEARED))
            with m.If(o.payload.last):
                m.d.comb += Assert((word == RECORD_WORDS - 1) & (of_source | status))
                m.d.sync += broken.eq(~of_source)
            m.d.comb += Assert(o.payload.last | ~of_source)
        # Words of a broken packet and of the next one never meet: between two sides there is a last word.
        with m.If(gate.buffer.o.valid & gate.buffer.o.ready & o.valid):
            m.d.sync += of_side.eq(data[0])
            m.d.comb += Assert(~begun | (data[0] == of_side))
        with m.If(begun & (of_side != side)):
            m.d.comb += Assert(gate.o_closing)
        m.d.comb += [Cover(given & broken & of_source), Cover(given & o.payload.last & of_source & (side != data[0]))]


def test_a_gate_passes_whole_packets_or_none(tmp_path: Path) -> None:
    prove(_Gate(), tmp_path)


def test_a_clear_ends_the_packet_under_way(tmp_path: Path) -> None:
    """Two clears within one packet do not count: the side of its words would look like that before the first."""
    prove(_Cleared(), tmp_path)


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
        fork(m, wiring.flipped(self.i), one.i, two.i)
        return m


def test_each_way_of_the_fork_gets_every_word_once(tmp_path: Path) -> None:
    branches = _Branches()
    prove(StreamContract(branches, depth=2, free=[branches.other.ready]), tmp_path)
