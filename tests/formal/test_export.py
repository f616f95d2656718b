"""The accelerator's ports keep the rules of AXI4-Lite and AXI4-Stream, whatever front end and matcher do.

Both are cut out: what they send is free, but for the form of their packets. Registers, clear, resets, buffers and
packet gates are those of the export.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from amaranth import Cat, Elaboratable, Module, Mux, Shape, Signal, Value
from amaranth.hdl import Assert, Assume, Cover
from amaranth.lib import stream, wiring
from amaranth.lib.wiring import In, Out

from golden_model.config import PRESETS
from golden_model.formats import WEIGHT
from golden_model.records import MATCH, WORD_BYTES
from hdl import accelerator
from hdl.axi.axi_lite import Response
from hdl.axi.video_input import VideoPayload
from hdl.build import Build
from hdl.streams import FRONT_END_SETTINGS, WordPayload
from tests.formal.proofs import happened, prove

CONFIG = PRESETS["aerial"]
ANSWER_CYCLES = 8
"""An access is accepted, and answered, within this many clocks."""
PATTERN = CONFIG.front_end.pattern
FEATURE_WORDS = PATTERN.record.record_bytes // WORD_BYTES
MATCH_WORDS = MATCH.record_bytes // WORD_BYTES
WORDS = stream.Signature(WordPayload)


class _Cut(wiring.Component):
    """A block whose outputs are free; its packets are whole records, unless a clear breaks them off."""

    def __init__(self, members: dict[str, Any], sends: str, record_words: int) -> None:
        super().__init__(members)
        self.record_words = record_words
        self.words: stream.Interface = getattr(self, sends)
        self.bits, self.last = Signal(2), Signal()
        outputs = [getattr(self, name) for name, member in members.items() if member.flow == Out and name != sends]
        self.free = [self.bits, self.words.valid, self.last, *outputs]

    def elaborate(self, platform: object) -> Module:
        """All bits of a word go the same way: two of them tell where."""
        m = Module()
        payload, sent = self.words.payload, Signal(range(self.record_words))
        m.d.comb += [Cat(payload.data[0], payload.data[-1]).eq(self.bits), payload.last.eq(self.last)]
        with m.If(self.words.valid & self.words.ready):
            m.d.sync += sent.eq(Mux(sent == self.record_words - 1, 0, sent + 1))
        m.d.comb += Assume(~self.last | (sent == self.record_words - 1))
        return m


def _front_end(_build: Build) -> _Cut:
    frames = {"o_frame_starts": Out(1), "o_frame_ends": Out(1)}
    inputs = {"i_video": In(stream.Signature(VideoPayload)), "settings": In(FRONT_END_SETTINGS)}
    return _Cut({**inputs, **frames, "o_features": Out(WORDS)}, "o_features", FEATURE_WORDS)


def _matcher(**_parameters: object) -> _Cut:
    inputs = {"i_hold_reference": In(1), "i_take_reference": In(1), "i_keep_above": In(WEIGHT.bits)}
    taken = {"o_frame_taken": Out(1), "o_reference_taken": Out(1)}
    return _Cut({"i_features": In(WORDS), **inputs, **taken, "o_matches": Out(WORDS)}, "o_matches", MATCH_WORDS)


class _Ports(Elaboratable):
    """Handshake, stability, reset, responses and packets at every port.

    In a reset, and in the first clock after it, the manager offers nothing. A reset passes a register: the accelerator
    offers nothing from its third clock on, until it is over.
    """

    def __init__(self) -> None:
        self.dut = dut = accelerator.Accelerator(Build(config=CONFIG))
        bus = dut.control
        self.ports = [
            dut.i_reset, dut.i_video.valid, dut.i_video.payload.as_value(), dut.o_features.ready, dut.o_matches.ready,
            bus.awaddr, bus.awvalid, bus.wdata, bus.wstrb, bus.wvalid, bus.bready, bus.araddr, bus.arvalid, bus.rready,
            *dut._front_end.free, dut._front_end.i_video.ready, *dut._matcher.free, dut._matcher.i_features.ready,
        ]  # fmt: skip

    def elaborate(self, platform: object) -> Module:
        m = Module()
        m.submodules.dut = dut = self.dut
        was_reset, was_long_reset = Signal(init=1), Signal(init=1)
        m.d.sync += [was_reset.eq(dut.i_reset), was_long_reset.eq(dut.i_reset & was_reset)]
        self.rests, self.is_quiet = Signal(), was_long_reset
        m.d.comb += self.rests.eq(dut.i_reset | was_reset)
        bus = dut.control
        for name in ("aw", "w", "ar"):
            valid = getattr(bus, f"{name}valid")
            with m.If(self.rests):
                m.d.comb += Assume(~valid)
        self._held(m, Assume, bus.awvalid, bus.awready, bus.awaddr)
        self._held(m, Assume, bus.wvalid, bus.wready, bus.wdata, bus.wstrb)
        self._held(m, Assume, bus.arvalid, bus.arready, bus.araddr)
        self._answers(m)
        for packets, record_words in ((dut.o_features, FEATURE_WORDS), (dut.o_matches, MATCH_WORDS)):
            self._packets(m, packets, record_words)
        m.d.comb += Cover(dut.o_interrupt)
        return m

    def _held(self, m: Module, rule: Callable[[Value], object], valid: Value, ready: Value, *stable: Value) -> None:
        """Nothing is withdrawn or changed before it is taken, except by a reset, in which nothing is offered."""
        waited = Signal()
        m.d.sync += waited.eq(valid & ~ready & ~self.rests)
        for value in stable:
            before = Signal(Shape.cast(Value.cast(value).shape()))
            m.d.sync += before.eq(value)
            with m.If(waited & ~self.rests):
                m.d.comb += rule(value == before)
        with m.If(waited & ~self.rests):
            m.d.comb += rule(valid)
        with m.If(self.is_quiet):
            m.d.comb += rule(~valid)

    def _waiting(self, m: Module, begins: Value, ends: Value) -> Signal:
        """How many accesses have begun and not ended; at most one, besides one that has just been accepted."""
        count = Signal(3)
        m.d.sync += count.eq(Mux(self.rests, 0, count + begins - ends))
        m.d.comb += Assert(self.rests | (count <= 2))
        return count

    def _soon(self, m: Module, waits: Value) -> None:
        clocks = Signal(range(ANSWER_CYCLES + 1))
        m.d.sync += clocks.eq(Mux(waits & ~self.rests, clocks + (clocks != ANSWER_CYCLES), 0))
        m.d.comb += Assert(clocks != ANSWER_CYCLES)

    def _answers(self, m: Module) -> None:
        """One response for each access, none without one; each comes soon, and is OKAY."""
        bus = self.dut.control
        written, read = bus.bvalid & bus.bready, bus.rvalid & bus.rready
        addresses = self._waiting(m, bus.awvalid & bus.awready, written)
        words = self._waiting(m, bus.wvalid & bus.wready, written)
        reads = self._waiting(m, bus.arvalid & bus.arready, read)
        self._held(m, Assert, bus.bvalid, bus.bready, bus.bresp)
        self._held(m, Assert, bus.rvalid, bus.rready, bus.rdata, bus.rresp)
        for valid, response, allowed in (
            (bus.bvalid, bus.bresp, (addresses != 0) & (words != 0)),
            (bus.rvalid, bus.rresp, reads != 0),
        ):
            with m.If(valid & ~self.rests):
                m.d.comb += Assert(allowed & (response == Response.OKAY))
        self._soon(m, (addresses != 0) & (words != 0) & ~bus.bvalid)
        self._soon(m, (reads != 0) & ~bus.rvalid)
        for valid, ready, waiting in (
            (bus.awvalid, bus.awready, addresses),
            (bus.wvalid, bus.wready, words),
            (bus.arvalid, bus.arready, reads),
        ):
            self._soon(m, valid & ~ready & (waiting == 0))
        m.d.comb += [Cover(happened(m, written, most=2) == 2), Cover(happened(m, read, most=2) == 2)]

    def _packets(self, m: Module, packets: stream.Interface, record_words: int) -> None:
        """Words are held; a packet ends with a whole record, also where a clear breaks it off."""
        word = Signal(range(record_words))
        given = packets.valid & packets.ready
        self._held(m, Assert, packets.valid, packets.ready, Value.cast(packets.payload))
        with m.If(self.rests):
            m.d.sync += word.eq(0)
        with m.Elif(given):
            m.d.sync += word.eq(Mux(word == record_words - 1, 0, word + 1))
            m.d.comb += Assert(~packets.payload.last | (word == record_words - 1))
        m.d.comb += Cover(given & packets.payload.last)


def test_every_port_keeps_its_protocol(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(accelerator, "FrontEnd", _front_end)
    monkeypatch.setattr(accelerator, "Matcher", _matcher)
    prove(_Ports(), tmp_path)
