# amaranth: UnusedElaboratable=no
"""Results of a pipeline wait until they are taken; none is lost, and none is late."""

from typing import Any

import pytest
from amaranth import Module
from amaranth.lib import stream, wiring
from amaranth.lib.wiring import In, Out

from hdl.lib.delay import delayed
from hdl.lib.result_queue import ResultQueue
from sim.simulators.recording import NO_PAUSES, Pauses
from tests.hdl.block_bench import BlockBench
from tests.hdl.drivers import run_streams

SENT = list(range(100))
RESULTS = [value + 1 for value in SENT]


class Increment(wiring.Component):
    """Adds 1, with a pipeline of some clocks."""

    i: In(stream.Signature(8))
    o: Out(stream.Signature(8))

    def __init__(self, pipeline_cycles: int) -> None:
        super().__init__()
        self.queue = ResultQueue(shape=8, pipeline_cycles=pipeline_cycles)

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


@pytest.mark.parametrize("cycles", [1, 4, 11])
@pytest.mark.parametrize("pauses", [NO_PAUSES, Pauses(gaps=120, stalls=60), Pauses(gaps=20, stalls=200)])
def test_results_leave_in_their_order(pauses: Pauses, cycles: int) -> None:
    assert run_streams(Increment(cycles), {"i": SENT}, {"o": len(SENT)}, pauses=pauses, cycle_limit=800)["o"] == RESULTS


@pytest.mark.parametrize("cycles", [1, 4, 11])
def test_one_result_leaves_per_clock_after_the_latency(cycles: int) -> None:
    dut = Increment(cycles)
    # A clock until it is ready after reset, one for each payload, the latency, and the bench stops in the next one.
    limit = 1 + len(SENT) + cycles + ResultQueue.latency_cycles + 1
    assert run_streams(dut, {"i": SENT}, {"o": len(SENT)}, cycle_limit=limit)["o"] == RESULTS


def test_a_reset_empties_queue_and_pipeline() -> None:
    dut = Increment(6)
    bench = BlockBench(dut, cycle_limit=200)
    received: list[Any] = []

    async def run(ctx: Any) -> None:
        for taken in range(1, 9):
            for value in range(taken):
                await bench.stream_put(ctx, dut.i, value)
            await bench.pulse(ctx, bench.reset)
            await bench.stream_put(ctx, dut.i, 100 + taken)
            received.append(await bench.stream_get(ctx, dut.o))

    bench.run(run)
    assert received == [101 + taken for taken in range(1, 9)]
