# amaranth: UnusedElaboratable=no
"""Matches leave in the golden order, frame after frame, also where the memory is full."""

from typing import Any

import numpy as np

from golden_model.geometry.ordering import order
from hdl.geometry.match_gain import PAIR
from hdl.geometry.ordering import MatchOrdering
from sim.simulators.recording import Pauses
from tests.hdl.block_bench import BlockBench

MAX_MATCHES = 24


def payloads(rows: np.ndarray, frame: int) -> list[dict[str, Any]]:
    """Matches and the end of their frame."""
    nothing = {"pair": dict.fromkeys(PAIR.members, 0), "weight": 0}
    matches = [{"pair": dict(zip(PAIR.members, row, strict=False)), "weight": row[-1]} for row in rows.tolist()]
    described = {"frame": frame, "width": 640, "height": 480, "good": 1}
    sent = [{"match": match, "ends": 0, "frame": dict.fromkeys(described, 0)} for match in matches]
    return [*sent, {"match": nothing, "ends": 1, "frame": described}]


def test_matches_are_placed_by_falling_weight() -> None:
    pauses = Pauses(gaps=90, stalls=0, seed=2)
    rng = np.random.default_rng(1)
    frames = [
        np.hstack((rng.integers(0, 1 << 16, (count, 4)), rng.choice([0, 1, 7, 254, 255], (count, 1))))
        for count in (9, MAX_MATCHES, MAX_MATCHES + 2, 1)
    ]
    dut = MatchOrdering(max_matches=MAX_MATCHES)
    placed: list[Any] = []

    async def send(ctx: Any) -> None:
        for number, rows in enumerate(frames):
            for payload in payloads(rows, number):
                await bench.stream_put(ctx, dut.i, payload)

    async def receive(ctx: Any) -> None:
        for number, rows in enumerate(frames):
            while not ctx.get(dut.o_complete):
                await ctx.tick()
            assert (ctx.get(dut.o_frame.frame), ctx.get(dut.o_too_many)) == (number, len(rows) > MAX_MATCHES)
            assert ctx.get(dut.o_count) == min(len(rows), MAX_MATCHES)
            await bench.pulse(ctx, dut.i_discard if ctx.get(dut.o_too_many) else dut.i_sort)
            found: dict[int, list[int]] = {}
            while not (ctx.get(dut.i.ready) or ctx.get(dut.o_too_many)):
                if ctx.get(dut.o_write):
                    match = dut.o_match
                    found[ctx.get(dut.o_address)] = [
                        *(ctx.get(match.pair[name]) for name in PAIR.members),
                        ctx.get(match.weight),
                    ]
                await ctx.tick()
            placed.append([found[rank] for rank in sorted(found)])

    bench = BlockBench(dut, pauses=pauses, cycle_limit=6000)
    bench.run(send, receive)
    wanted = [rows[order(rows[:, 4])].tolist() if len(rows) <= MAX_MATCHES else [] for rows in frames]
    assert placed == wanted
