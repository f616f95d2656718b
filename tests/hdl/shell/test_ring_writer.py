"""Packets in a ring: the header comes last, and says what is behind it; the rest of the slot stays as it was."""

import random
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

from golden_model.records import WORD_BYTES
from hdl.settings import PAGE_BYTES
from hdl.shell.ring_writer import RingWriter
from hdl.shell.slot import HEADER, HEADER_BYTES, HeaderFlag, slot_pages
from sim.simulators.recording import Pauses
from tests.hdl.block_bench import BlockBench, Testbench
from tests.hdl.shell.axi_memory import AxiMemory

RECORD_WORDS, MAX_WORDS = 4, 400
SLOTS, BASE = 3, 0x7_0000_1000
UNTOUCHED = 0xA5
START = 5000
"""The clocks since reset when the ring begins."""


def frame_time(number: int) -> int:
    """When a packet's frame started, 500 clocks before the ring."""
    return START - 500 - 7 * number


class RingBench:
    """A writer with a memory; a host that frees slots at once, unless it does not read."""

    def __init__(self, *, reads: bool = True, gaps: int = 0, **rules: Any) -> None:
        self.memory = AxiMemory(BASE, SLOTS * PAGE_BYTES, **rules)
        self.memory.bytes[:] = UNTOUCHED
        self.dut = RingWriter(record_words=RECORD_WORDS, max_words=MAX_WORDS, fifo_words=64)
        settings = {"i_enable": 1, "i_base_page": BASE // PAGE_BYTES, "i_slots": SLOTS, "i_slot_pages": 1}
        self.bench = BlockBench(self.dut, settings=settings, pauses=Pauses(gaps=gaps, seed=3), cycle_limit=20_000)
        self.reads = reads
        self.delivered: list[tuple[np.void, list[int]]] = []
        self.times: list[int] = []
        self.ended = self.lost = self.errors = 0

    def run(
        self,
        packets: list[list[int]],
        *,
        off: tuple[int, ...] = (),
        pause_clocks: int = 3,
        infos: int | None = None,
        others: Sequence[Testbench] = (),
    ) -> None:
        """Send packets one behind the other; while those in ``off`` are sent, the ring is off.

        Only the first ``infos`` packets belong to a frame.
        """

        async def send(ctx: Any) -> None:
            for number, words in enumerate(packets):
                if number in off or number - 1 in off:
                    await self._wait(ctx, number)
                    ctx.set(self.dut.i_enable, number not in off)
                    await ctx.tick().repeat(3)
                await ctx.tick().repeat(pause_clocks)
                for n, word in enumerate(words):
                    await self.bench.stream_put(ctx, self.dut.i, {"data": word, "last": n == len(words) - 1})
            await self._wait(ctx, len(packets))
            self.lost, self.errors = ctx.get(self.dut.o_lost), ctx.get(self.dut.o_errors)

        async def inform(ctx: Any) -> None:
            for number in range(1, (len(packets) if infos is None else infos) + 1):
                # Always there before the packet.
                ctx.set(self.dut.i_info.payload, {"number": 10 * number, "time": frame_time(number)})
                ctx.set(self.dut.i_info.valid, 1)
                await ctx.tick().until(self.dut.i_info.ready)
            ctx.set(self.dut.i_info.valid, 0)

        self.bench.run(send, inform, background=[self.memory.port(self.dut.bus), self._host, self._watch, *others])

    async def _watch(self, ctx: Any) -> None:
        """The header's burst, at the start of a page, begins when every other one has its answer.

        Each burst begins when all of it is there: the memory never waits for words.
        """
        unanswered, bus, is_within = 0, self.dut.bus, 0
        words = bus.wvalid, bus.wready, bus.wlast
        async for *_, valid, ready, address, answer, word, takes, last in ctx.tick().sample(
            bus.awvalid, bus.awready, bus.awaddr, bus.bvalid, *words
        ):
            assert not valid or address % PAGE_BYTES or not unanswered
            unanswered += (valid & ready) - answer
            assert word or not is_within
            is_within = (is_within | word) & ~(word & takes & last)

    async def _wait(self, ctx: Any, ended: int) -> None:
        while self.ended < ended:
            await ctx.tick()
        await ctx.tick().repeat(3)

    async def _host(self, ctx: Any) -> None:
        time, before = START, 0
        async for *_, ended, written in ctx.tick().sample(self.dut.o_ended, self.dut.o_written):
            time += 1
            self.ended += ended
            ctx.set(self.dut.i_time, time)
            if written > before:
                self.delivered.append(self.slot(before % SLOTS))
                self.times.append(time)
            before = written
            ctx.set(self.dut.i_full, not self.reads and ctx.get(self.dut.o_written) >= SLOTS)

    def slot(self, number: int) -> tuple[np.void, list[int]]:
        slot = self.memory.bytes[number * PAGE_BYTES :][:PAGE_BYTES].copy()
        header = slot[: HEADER.itemsize].view(HEADER)[0]
        end = HEADER_BYTES + int(header["length_bytes"])
        assert (slot[HEADER.itemsize : HEADER_BYTES] == UNTOUCHED).all()
        assert len(self.delivered) >= SLOTS or (slot[end:] == UNTOUCHED).all()
        return header, slot[HEADER_BYTES:end].view("<u8").tolist()


def packet(records: int, number: int) -> list[int]:
    return [number << 32 | n + 1 for n in range(records * RECORD_WORDS)]


@pytest.mark.parametrize(
    "rules",
    [{"waits": 130, "latency_clocks": 30, "seed": 1}, {"data_first": True, "waits": 60, "gaps": 170}],
    ids=["slow", "data first"],
)
def test_packets_of_any_length_arrive_with_their_headers(rules: dict[str, Any]) -> None:
    bench, rng = RingBench(**rules), random.Random(2)
    # One burst, whole bursts, a word more, and the longest.
    packets = [packet(records, n) for n, records in enumerate((1, 5, 16, 11, MAX_WORDS // RECORD_WORDS))]
    packets += [packet(rng.randrange(1, 40), n) for n in range(5, 8)]
    bench.run(packets)
    assert [words for _, words in bench.delivered] == packets
    for n, ((header, words), sent) in enumerate(zip(bench.delivered, packets, strict=True), 1):
        assert (int(header["sequence"]), int(header["number"]), int(header["time"])) == (n, 10 * n, frame_time(n))
        assert (int(header["length_bytes"]), int(header["flags"])) == (len(words) * WORD_BYTES, 0)
        # The first word of the last record.
        assert int(header["status"]) == sent[-RECORD_WORDS]
        # The header's own way takes some more.
        assert -200 < frame_time(n) + int(header["clocks"]) - bench.times[n - 1] < 0


@pytest.mark.parametrize(("words", "pages"), [(1, 1), (496, 1), (497, 2), (1008, 2), (1009, 3)])
def test_a_slot_has_pages_for_its_header_and_its_words(words: int, pages: int) -> None:
    assert slot_pages(words) == pages


def test_what_waits_for_the_memory_does_not_change_when_the_next_packet_comes() -> None:
    """The memory stops behind the last word of a packet, in the words that fill its burst; it checks what waits."""
    bench = RingBench()
    bus = bench.dut.bus

    async def stop(ctx: Any) -> None:
        accepted = 0
        while accepted < RECORD_WORDS + 2:
            *_, valid, ready = await ctx.tick().sample(bus.wvalid, bus.wready)
            accepted += valid & ready
        bench.memory.stuck = True
        # It goes on when the words of the next packet have long arrived.
        await ctx.tick().repeat(60)
        bench.memory.stuck = False

    bench.run([packet(1, 1), packet(1, 2)], pause_clocks=30, others=[stop])
    assert [words for _, words in bench.delivered] == [packet(1, 1), packet(1, 2)]


def test_a_packet_that_is_too_long_is_cut_and_flagged() -> None:
    bench = RingBench()
    room_words = (PAGE_BYTES - HEADER_BYTES) // WORD_BYTES
    bench.run([packet(150, 1), packet(2, 2)])
    header, _ = bench.delivered[0]
    assert int(header["flags"]) == HeaderFlag.OVERLONG
    assert int(header["length_bytes"]) == 600 * WORD_BYTES
    written = bench.memory.bytes[HEADER_BYTES:PAGE_BYTES].view("<u8").tolist()
    assert written == packet(150, 1)[:room_words]
    assert bench.delivered[1][1] == packet(2, 2)


def test_a_packet_of_no_frame_has_neither_number_nor_time() -> None:
    bench = RingBench()
    bench.run([packet(2, 1), packet(2, 2)], infos=1)
    headers = [header for header, _ in bench.delivered]
    assert [(int(each["number"]), int(each["time"])) for each in headers] == [(10, frame_time(1)), (0, 0)]


def test_a_ring_is_active_to_the_end_of_a_packet_that_began_as_it_was_switched_off() -> None:
    """Longer than its slot, so that most of it is discarded before its header."""
    bench = RingBench()
    active: list[int] = []

    async def switch_off(ctx: Any) -> None:
        while not ctx.get(bench.dut.i_info.ready):
            await ctx.tick()
        ctx.set(bench.dut.i_enable, 0)
        async for *_, is_active in ctx.tick().sample(bench.dut.o_active):
            active.append(is_active)

    bench.run([packet(150, 1)], others=[switch_off])
    ((header, _),) = bench.delivered
    assert int(header["flags"]) == HeaderFlag.OVERLONG
    assert active == sorted(active, reverse=True)
    assert active.index(0) > 600


def test_without_a_free_slot_a_packet_is_lost_and_counted() -> None:
    bench = RingBench(reads=False)
    packets = [packet(2, n) for n in range(SLOTS + 2)]
    bench.run(packets)
    assert [words for _, words in bench.delivered] == packets[:SLOTS]
    assert (bench.ended, bench.lost, bench.errors) == (len(packets), 2, 0)


def test_a_ring_that_is_off_takes_nothing_and_begins_again() -> None:
    bench = RingBench()
    packets = [packet(3, n) for n in range(4)]
    bench.run(packets, off=(1, 2))
    assert [words for _, words in bench.delivered] == [packets[0], packets[3]]
    assert [int(header["sequence"]) for header, _ in bench.delivered] == [1, 1]
    # Both in the first slot: what came while the ring was off is nowhere.
    assert (bench.memory.bytes[PAGE_BYTES:] == UNTOUCHED).all()
    assert (bench.ended, bench.lost) == (4, 0)
