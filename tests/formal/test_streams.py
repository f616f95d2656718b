from pathlib import Path

import pytest
from amaranth import Elaboratable, Module, unsigned
from amaranth.hdl import Assert, Assume, Cover
from amaranth.lib import stream, wiring
from amaranth.lib.wiring import In, Out

from hdl.axi.axi_lite import AxiLiteSubordinate
from hdl.lib.delay import delayed
from hdl.lib.result_queue import ResultQueue
from hdl.lib.skid_buffer import SkidBuffer
from tests.formal.proofs import StreamContract, happened, held, in_flight, prove

PAYLOAD = unsigned(2)


def test_the_skid_buffer_keeps_the_contract(tmp_path: Path) -> None:
    prove(StreamContract(SkidBuffer(shape=PAYLOAD), depth=2), tmp_path)


class _Pipeline(wiring.Component):
    """Two registers that do not wait, and the queue behind them."""

    def __init__(self) -> None:
        self.queue = ResultQueue(shape=PAYLOAD, pipeline_cycles=2)
        super().__init__({"i": In(stream.Signature(PAYLOAD)), "o": Out(stream.Signature(PAYLOAD))})

    def elaborate(self, platform: object) -> Module:
        m = Module()
        m.submodules.queue = queue = self.queue
        wiring.connect(m, queue.o, wiring.flipped(self.o))
        m.d.comb += [
            self.i.ready.eq(queue.o_ready),
            queue.i_start.eq(self.i.valid & queue.o_ready),
            queue.i_result.eq(delayed(m, self.i.payload, queue.pipeline_cycles)),
        ]
        return m


def test_a_pipeline_and_its_queue_keep_the_contract(tmp_path: Path) -> None:
    # Those on their way, those in the queue, and one whose place is just known to be free.
    prove(StreamContract(_Pipeline(), depth=5), tmp_path)


class _Forgetful(wiring.Component):
    """A register stage that forgets what waits when something new comes: the checker must find it out."""

    def __init__(self) -> None:
        super().__init__({"i": In(stream.Signature(PAYLOAD)), "o": Out(stream.Signature(PAYLOAD))})

    def elaborate(self, platform: object) -> Module:
        m = Module()
        m.d.comb += self.i.ready.eq(1)
        with m.If(self.i.valid):
            m.d.sync += [self.o.valid.eq(1), self.o.payload.eq(self.i.payload)]
        with m.Elif(self.o.ready):
            m.d.sync += self.o.valid.eq(0)
        return m


def test_the_checker_finds_a_forgetful_stage(tmp_path: Path) -> None:
    with pytest.raises(AssertionError, match="FAIL"):
        prove(StreamContract(_Forgetful(), depth=2), tmp_path)


class _AxiLiteContract(Elaboratable):
    """Responses are held, one an access, none without one; reads and writes do not block each other."""

    def __init__(self) -> None:
        self.block = AxiLiteSubordinate()
        bus = self.block.bus
        self.ports = [
            bus.awaddr, bus.awvalid, bus.wdata, bus.wstrb, bus.wvalid, bus.bready, bus.araddr, bus.arvalid, bus.rready,
            self.block.i_data,
        ]  # fmt: skip

    def elaborate(self, platform: object) -> Module:
        m = Module()
        m.submodules.block = block = self.block
        bus = block.bus
        held(m, Assume, bus.awvalid, bus.awready, bus.awaddr)
        held(m, Assume, bus.wvalid, bus.wready, bus.wdata, bus.wstrb)
        held(m, Assume, bus.arvalid, bus.arready, bus.araddr)
        held(m, Assert, bus.bvalid, bus.bready, bus.bresp)
        held(m, Assert, bus.rvalid, bus.rready, bus.rdata, bus.rresp)
        answered, read = bus.bvalid & bus.bready, bus.rvalid & bus.rready
        in_flight(m, bus.awvalid & bus.awready, block.o_write, most=2)
        in_flight(m, bus.wvalid & bus.wready, block.o_write, most=2)
        in_flight(m, block.o_write, answered, most=1)
        in_flight(m, bus.arvalid & bus.arready, read, most=2)
        answers, reads = happened(m, answered, most=2), happened(m, read, most=2)
        m.d.comb += [
            Cover(answers == 2),
            Cover(reads == 2),
            Cover((answers == 1) & bus.bvalid & bus.rvalid),
        ]
        return m


def test_axi_lite_answers_every_access_once_and_holds_the_answer(tmp_path: Path) -> None:
    prove(_AxiLiteContract(), tmp_path)
