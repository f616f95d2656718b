# amaranth: UnusedElaboratable=no
"""Running a row, and the bench of the other tests, fail on whatever a block does wrong."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import pytest
from amaranth.hdl import Module, Signal
from amaranth.lib import stream, wiring
from amaranth.lib.wiring import In, Out

from hdl.blocks.vectors import Block, of_stream
from hdl.lib.skid_buffer import SkidBuffer
from sim.benches.rows import check
from sim.simulators.recording import Pauses
from tests.hdl.block_bench import BlockBench, CycleLimitError

SENT = range(100)


class Wrong(wiring.Component):
    """A register stage of a stream that does one thing wrong."""

    i: In(stream.Signature(8))
    o: Out(stream.Signature(8))
    latency_cycles = 1

    def __init__(self, fault: str) -> None:
        super().__init__()
        self.fault = fault

    def elaborate(self, platform: object) -> Module:
        m = Module()
        full, kept = Signal(), Signal()
        ready = 1 if self.fault == "forgets" else ~self.o.valid | self.o.ready
        m.d.comb += [self.i.ready.eq(ready), self.o.valid.eq(full)]
        with m.If(self.i.ready):
            m.d.sync += [full.eq(self.i.valid), self.o.payload.eq(self.i.payload)]
        if self.fault == "doubles":
            m.d.sync += kept.eq(~kept)
            m.d.comb += self.i.ready.eq(ready & kept)
            with m.If(~kept):
                m.d.sync += full.eq(full)
        if self.fault == "stops":
            m.d.sync += kept.eq(kept | (self.i.payload == SENT[60]))
            m.d.comb += self.o.valid.eq(full & ~kept)
        return m


def block(dut: Any, answers: Sequence[int] = SENT, clocks_each: int | None = None) -> Block:
    return replace(of_stream(dut, "", SENT, answers), clocks_each=clocks_each, idle_cycles=200)


@pytest.mark.parametrize(
    ("fault", "says"),
    [("forgets", "withdrawn or changed"), ("doubles", "answer 1"), ("stops", r"withdrawn|no more answers")],
)
def test_a_stream_that_breaks_its_rules_is_found_out(fault: str, says: str) -> None:
    with pytest.raises(AssertionError, match=says):
        check(block(Wrong(fault)))


@pytest.mark.parametrize(
    ("fault", "more", "says", "error"),
    [("forgets", 0, "withdrawn before it was taken", AssertionError), ("", 1, "not done within 900", CycleLimitError)],
)
def test_a_bench_finds_it_out_too(fault: str, more: int, says: str, error: type[AssertionError]) -> None:
    dut = Wrong(fault)
    bench = BlockBench(dut, pauses=Pauses(stalls=200, seed=1), cycle_limit=900)

    async def send(ctx: Any) -> None:
        for number in SENT:
            await bench.stream_put(ctx, dut.i, number)

    async def take(ctx: Any) -> None:
        for _ in range(len(SENT) + more):
            await bench.stream_get(ctx, dut.o)

    with pytest.raises(error, match=says):
        bench.run(send, take)


def test_times_are_checked() -> None:
    check(block(Wrong("")))
    late, slow = SkidBuffer(shape=8), SkidBuffer(shape=8)
    late.latency_cycles += 1
    for wrong in (block(late), block(slow, clocks_each=2)):
        with pytest.raises(AssertionError):
            check(wrong)


def test_an_answer_too_many_and_one_too_few_are_found_out() -> None:
    for answers in (SENT[:-1], [*SENT, 7]):
        with pytest.raises(AssertionError, match=r"more answers than inputs|no more answers"):
            check(block(SkidBuffer(shape=8), answers))
