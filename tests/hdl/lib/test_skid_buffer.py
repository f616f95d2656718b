# amaranth: UnusedElaboratable=no
"""Nothing is lost, reordered or late, and no signal of one side depends on the other in the same clock."""

from typing import Any

import pytest

from hdl.lib.skid_buffer import SkidBuffer
from sim.simulators.recording import NO_PAUSES, Pauses
from tests.hdl.block_bench import BlockBench
from tests.hdl.drivers import run_streams

SENT = list(range(1, 101))


@pytest.mark.parametrize("pauses", [NO_PAUSES, Pauses(gaps=120, stalls=60), Pauses(gaps=60, stalls=160)])
def test_payloads_leave_in_their_order(pauses: Pauses) -> None:
    dut = SkidBuffer(shape=8)
    assert run_streams(dut, {"i": SENT}, {"o": len(SENT)}, pauses=pauses, cycle_limit=600)["o"] == SENT


def test_one_payload_leaves_per_clock_after_the_latency() -> None:
    dut = SkidBuffer(shape=8)
    # A clock until it is ready after reset, one for each payload, the latency, and the bench stops in the next one.
    cycles = 1 + len(SENT) + dut.latency_cycles + 1
    assert run_streams(dut, {"i": SENT}, {"o": len(SENT)}, cycle_limit=cycles)["o"] == SENT


def test_no_path_leads_from_one_side_to_the_other() -> None:
    dut = SkidBuffer(shape=8)

    async def run(ctx: Any) -> None:
        ctx.set(dut.i.payload, 1)
        for valid, ready in ((0, 0), (1, 0), (1, 0), (1, 1), (0, 1), (1, 1)):
            before = ctx.get(dut.i.ready), ctx.get(dut.o.valid), ctx.get(dut.o.payload)
            for each in (0, 1):
                ctx.set(dut.i.valid, each)
                ctx.set(dut.o.ready, each)
                ctx.set(dut.i.payload, 2 + each)
                assert (ctx.get(dut.i.ready), ctx.get(dut.o.valid), ctx.get(dut.o.payload)) == before
            ctx.set(dut.i.valid, valid)
            ctx.set(dut.o.ready, ready)
            await ctx.tick()

    BlockBench(dut).run(run)


def test_two_payloads_fit_in_while_none_leaves() -> None:
    dut = SkidBuffer(shape=8)
    ready: list[int] = []

    async def run(ctx: Any) -> None:
        for valid in (1, 1, 0, 0, 1, 1, 1):
            ctx.set(dut.i.valid, valid)
            ready.append(ctx.get(dut.i.ready))
            await ctx.tick()

    BlockBench(dut).run(run)
    # It is not ready in the first clock, after the reset, nor once the second payload has been taken.
    assert ready == [0, 1, 1, 1, 1, 0, 0]
