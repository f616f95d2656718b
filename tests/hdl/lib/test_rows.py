# amaranth: UnusedElaboratable=no
"""Queues and buffers pass everything on in its order, one payload per clock; `tests/formal` proves the rest."""

from dataclasses import replace
from functools import partial
from random import Random

from amaranth import Module
from amaranth.lib import stream, wiring
from amaranth.lib.wiring import In, Out

from hdl.blocks.vectors import Block, of_stream
from hdl.lib.delay import delayed
from hdl.lib.result_queue import ResultQueue
from hdl.lib.skid_buffer import SkidBuffer
from tests.hdl.rows import row_test

PAYLOAD = 2


class Pipeline(wiring.Component):
    """Some registers that do not wait, and the queue behind them."""

    i: In(stream.Signature(PAYLOAD))
    o: Out(stream.Signature(PAYLOAD))

    def __init__(self, pipeline_cycles: int) -> None:
        super().__init__()
        self.queue = ResultQueue(shape=PAYLOAD, pipeline_cycles=pipeline_cycles)
        self.latency_cycles = pipeline_cycles + self.queue.latency_cycles

    def elaborate(self, platform: object) -> Module:
        m = Module()
        m.submodules.queue = self.queue
        wiring.connect(m, self.queue.o, wiring.flipped(self.o))
        m.d.comb += [
            self.i.ready.eq(self.queue.o_ready),
            self.queue.i_start.eq(self.i.valid & self.queue.o_ready),
            self.queue.i_result.eq(delayed(m, self.i.payload, self.queue.pipeline_cycles)),
        ]
        return m


def passes(dut: object) -> Block:
    sent = Random(1).choices(range(1 << PAYLOAD), k=100)
    return replace(of_stream(dut, "", sent, sent), clocks_each=1)


def buffer() -> Block:
    return passes(SkidBuffer(shape=PAYLOAD))


def queue(pipeline_cycles: int) -> Block:
    return passes(Pipeline(pipeline_cycles))


test_rows = row_test({"buffer": buffer, **{f"queue of {n}": partial(queue, n) for n in (1, 4, 11)}})
