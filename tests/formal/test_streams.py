from pathlib import Path

import pytest
from amaranth import Module, unsigned
from amaranth.lib import stream, wiring
from amaranth.lib.wiring import In, Out

from hdl.lib.delay import delayed
from hdl.lib.result_queue import ResultQueue
from tests.formal.proofs import StreamContract, prove

PAYLOAD = unsigned(2)


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
