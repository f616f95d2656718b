# amaranth: UnusedElaboratable=no
"""Queues and buffers pass everything on in its order, one payload per clock; `tests/formal` proves the rest."""

from functools import partial

from amaranth import Module
from amaranth.lib import stream, wiring
from amaranth.lib.wiring import In, Out

from hdl.blocks.vectors import Block, of_stream
from hdl.lib.delay import delayed
from hdl.lib.result_queue import ResultQueue
from hdl.lib.skid_buffer import SkidBuffer
from sim.benches.rows import Row, check
from tests.hdl.rows import table


class Increment(wiring.Component):
    """Adds 1, with a pipeline of some clocks and the queue behind it."""

    i: In(stream.Signature(8))
    o: Out(stream.Signature(8))

    def __init__(self, pipeline_cycles: int) -> None:
        super().__init__()
        self.queue = ResultQueue(shape=8, pipeline_cycles=pipeline_cycles)
        self.latency_cycles = pipeline_cycles + self.queue.latency_cycles

    def elaborate(self, platform: object) -> Module:
        m = Module()
        m.submodules.queue = self.queue
        wiring.connect(m, self.queue.o, wiring.flipped(self.o))
        m.d.comb += [
            self.i.ready.eq(self.queue.o_ready),
            self.queue.i_start.eq(self.i.valid & self.queue.o_ready),
            self.queue.i_result.eq(delayed(m, self.i.payload + 1, self.queue.pipeline_cycles)),
        ]
        return m


def queue(pipeline_cycles: int) -> Block:
    return of_stream(Increment(pipeline_cycles), "", range(100), range(1, 101))


@table(
    buffer=Row(lambda: of_stream(SkidBuffer(shape=8), "", range(100), range(100)), clocks_each=1),
    queue_of_1=Row(partial(queue, 1), clocks_each=1),
    queue_of_4=Row(partial(queue, 4), clocks_each=1),
    queue_of_11=Row(partial(queue, 11), clocks_each=1),
)
def test_everything_leaves_in_its_order(row: Row) -> None:
    check(row)
