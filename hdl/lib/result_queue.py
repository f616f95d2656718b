"""A queue behind a pipeline that cannot wait, so that both together are a stage of a stream."""

from amaranth import Module, ShapeLike, Signal, Value
from amaranth.lib import fifo, stream, wiring
from amaranth.lib.wiring import In, Out

from hdl.lib.component import Component
from hdl.lib.delay import delayed

RETURN_CYCLES = 1
"""Clocks from a result that is taken to the start that its place allows."""


class ResultQueue(Component):
    """Keeps the results of a pipeline until they are taken; there is a place for each that has been started.

    Registers of multipliers and block RAMs run on in every clock, and a signal that stops a long pipeline would limit
    the clock. So the pipeline starts something only while ``o_ready``, which is a register, and never stops. The
    throughput is one result per clock. A reset empties queue and pipeline.

    Parameters
    ----------
    shape : ShapeLike
        Shape of a result.
    pipeline_cycles : int
        Clocks from a start to its result.
    """

    i_start: In(1)
    """Something enters the pipeline; only while ``o_ready``."""
    i_result: Signal
    """What has been started ``pipeline_cycles`` before."""
    o_ready: Out(1)
    """The pipeline may start something in this clock."""
    o: stream.Interface
    """The results, in their order."""

    latency_cycles = 2
    """From a result to the head of an empty queue."""

    def __init__(self, *, shape: ShapeLike, pipeline_cycles: int) -> None:
        self.pipeline_cycles = pipeline_cycles
        super().__init__(i_result=In(shape), o=Out(stream.Signature(shape)))

    def elaborate(self, platform: object) -> Module:
        """Count what has been started and not taken."""
        m = Module()
        result = Value.cast(self.i_result)
        # As many places as starts until the first result has left and its place is known to be free.
        places = self.pipeline_cycles + self.latency_cycles + RETURN_CYCLES
        m.submodules.results = results = fifo.SyncFIFOBuffered(width=len(result), depth=places)
        m.d.comb += [
            results.w_en.eq(delayed(m, self.i_start, self.pipeline_cycles, reset_less=False)),
            results.w_data.eq(result),
        ]
        wiring.connect(m, results.r_stream, wiring.flipped(self.o))
        owed = Signal(range(places + 1))
        following = Signal.like(owed)
        m.d.comb += following.eq(owed + self.i_start - (self.o.valid & self.o.ready))
        # 0 after reset: what a stream takes in the clock of the reset would be lost.
        m.d.sync += [owed.eq(following), self.o_ready.eq(following != places)]
        return m


def queue_results(m: Module, i: stream.Interface, o: stream.Interface, *, pipeline_cycles: int) -> ResultQueue:
    """Add the queue that makes a stage of a stream of the pipeline from ``i`` to ``i_result``."""
    m.submodules.queue = queue = ResultQueue(shape=o.payload.shape(), pipeline_cycles=pipeline_cycles)
    wiring.connect(m, queue.o, wiring.flipped(o))
    m.d.comb += [i.ready.eq(queue.o_ready), queue.i_start.eq(i.valid & queue.o_ready)]
    return queue
