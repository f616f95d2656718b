# amaranth: UnusedElaboratable=no
"""Every placement is answered by the golden model's pose, or refused with its causes."""

from typing import Any

import numpy as np

from golden_model.geometry.fixed_point import quantise
from golden_model.painting.pose import Placement, PoseCause, Poses, elements
from hdl.painting import pose as hardware
from sim.simulators.recording import Pauses
from tests.golden_model.painting.poses import homography
from tests.hdl.block_bench import BlockBench

SIZE = (640, 480)
MAX_LINKS = 3


def placements() -> list[Placement]:
    """Host's poses and records of all kinds, good and bad, in any order; numbers of frames are used again."""
    rng = np.random.default_rng(4)
    given = []
    for n in range(15):
        H = homography(SIZE, rng.uniform(0, 4096, 2), turn=rng.uniform(0, 7), zoom=2.0 ** rng.uniform(-1, 1))
        record = np.eye(3) + rng.normal(0, [[0.1, 0.1, 40], [0.1, 0.1, 40], [1e-4, 1e-4, 0.1]])
        composed = n > 0 and n % 6 != 0
        entries = quantise((record if composed else H)[np.newaxis])[0]
        if n % 9 == 5:
            entries[0] *= -1
        elif n == 8:
            entries[2, 1] = 1 << 24
        elif n == 13:
            # Its products cancel but for a few bits: all headroom is used.
            entries = entries >> 22
        elif n == 12:
            # Two rows are equal, and no product of their elements is 0.
            entries = np.array([[1, 0, 0], [1, 1, 1], [1, 1, 1]]) << 23
        elif n == 2:
            # No frame is its own reference.
            given.append(Placement(1, 1, entries, composed))
        given.append(Placement(n % 7, max(n - 1 - (n % 4 == 3), 0) % 7, entries, composed))
    return given


def payload(placement: Placement) -> dict[str, Any]:
    fields = {name: getattr(placement, name) for name in ("frame", "reference", "composed")}
    return {"elements": placement.elements.ravel().tolist(), **fields}


def test_poses_are_those_of_the_golden_model() -> None:
    """After a reset in the middle of a composition, which forgets what was kept; placements come back to back."""
    given = placements()
    golden = Poses(MAX_LINKS)
    wanted = [golden.place(each) for each in given]
    assert {int(causes) for _, causes in wanted} >= {0, 2, 4, 5, 8}
    dut = hardware.Poses()
    answers: list[int] = []
    columns: list[list[int]] = []
    waits: dict[bool, int] = {}

    async def send(ctx: Any) -> None:
        ctx.set(dut.o.ready, 1)
        await bench.stream_put(ctx, dut.i, payload(given[0]))
        ctx.set(dut.o.ready, 0)
        ctx.set(dut.i.payload, payload(given[1]))
        ctx.set(dut.i.valid, 1)
        await ctx.tick().repeat(1000)
        await bench.pulse(ctx, bench.reset)
        columns.clear()
        for each in [given[1], *given]:
            await bench.stream_put(ctx, dut.i, payload(each))

    async def watch(ctx: Any) -> None:
        clock = 0
        while True:
            handshake = dut.i.valid & dut.i.ready
            *_, taken, offers, refused, causes = await ctx.tick().sample(
                handshake, dut.o.valid, dut.o_refused, dut.o_causes
            )
            clock += 1
            if offers:
                waits.setdefault(bool(ctx.get(dut.i.payload.composed)), clock)
            if taken:
                answers.append(causes if refused else 0)
                clock = 0

    async def receive(ctx: Any) -> None:
        await ctx.tick().repeat(1500)
        while len(answers) < len(given) + 2:
            if ctx.get(dut.o.valid):
                column = await bench.stream_get(ctx, dut.o)
                columns.append([column.x, column.y, column.w])
            else:
                await ctx.tick()

    bench = BlockBench(
        dut, settings={"i_max_links": MAX_LINKS}, pauses=Pauses(gaps=0, stalls=120, seed=2), cycle_limit=30_000
    )
    bench.run(send, receive, background=[watch])
    assert answers == [0, PoseCause.UNKNOWN_REFERENCE, *(int(causes) for _, causes in wanted)]
    cut = [elements(found)[:, [2, 0, 1]].T.tolist() for found, _ in wanted if found is not None]
    assert columns == [column for each in cut for column in each]
    assert waits[False] < 400
    assert waits[True] < 2200
