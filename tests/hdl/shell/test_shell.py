# amaranth: UnusedElaboratable=no
"""Whole frames or none from a camera into memory: what is not delivered is reported, and nothing is ever wrong."""

from typing import Any

import pytest
from amaranth import Module
from amaranth.lib import wiring

from hdl.registers.shell_register_map import Reason, Refusal, RingFault
from hdl.settings import PAGE_BYTES, TICK_CLOCKS
from hdl.shell.painting import Painting
from hdl.shell.shell import MAX_IN_FLIGHT
from hdl.shell.slot import HeaderFlag
from tests.hdl.shell.axi_memory import AxiMemory
from tests.hdl.shell.bench import (
    BASES,
    HEIGHT_PX,
    RECORD_WORDS,
    RINGS,
    SLOTS,
    SYNC_S,
    WIDTH_PX,
    Run,
    ShellBench,
    flight,
    frame,
    registers,
    settings,
)

FRAMES = 6
PAUSE = [None] * 60


def memory(**rules: Any) -> AxiMemory:
    return AxiMemory(BASES["features"], len(RINGS) * SLOTS * PAGE_BYTES, **rules)


def check(bench: ShellBench, run: Run, *, whole: int | None = None) -> None:
    """Everything the camera sent was delivered, cut or dropped, and what is marked good is what was sent."""
    counts = bench.values
    for ring in RINGS:
        packets, emitted = run.delivered[ring], run.emitted[ring]
        assert counts["camera_frames"] == len(run.sent) == counts["dropped"] + len(emitted)
        numbers = [int(packet.header["number"]) for packet in packets]
        assert numbers == sorted(set(numbers))
        assert [int(packet.header["sequence"]) for packet in packets] == list(range(1, len(packets) + 1))
        for packet in packets:
            if packet.header["flags"]:
                continue
            words = emitted[int(packet.header["sequence"]) - 1]
            assert packet.words.tolist() == words
            status = words[-bench.shell.rings[ring].record_words]
            assert int(packet.header["status"]) == status
            pixels = run.sent[int(packet.header["number"])]
            assert status >> 32 == pixels[0]
            if status >> 8 & 1:
                assert len(pixels) >= WIDTH_PX * HEIGHT_PX
        if whole is not None:
            assert len(packets) == whole
            assert len(emitted) == whole
    assert counts["cut"] == sum(not words[-3] >> 8 & 1 for words in run.emitted["features"])


def test_a_host_that_never_reads_gets_the_oldest_frames_whole() -> None:
    # A memory that waits for data before it accepts their address: the writer must not wait for that, too.
    bench = ShellBench(seed=5, memory=memory(data_first=True), reads=False, coalesce_count=3)
    run = bench.simulate(list(flight(SLOTS + 2)), clocks_after=200)
    assert bench.values["dropped"] == 2 == run.events["frame_dropped"]
    assert bench.values["dropped_reason"] == Reason.NO_BUFFER
    assert run.events["frames_ready"] == 1
    for ring in RINGS:
        slots = [bench.slot(ring, number) for number in range(SLOTS)]
        assert [int(slot.header["number"]) for slot in slots] == list(range(1, SLOTS + 1))
        assert [slot.words.tolist() for slot in slots] == run.emitted[ring]


def test_settings_that_cannot_work_are_refused() -> None:
    changes = [
        (
            {"features_base_low": BASES["features"] + 128 & 0xFFFF_FFFF},
            {"refused": Refusal.FEATURES_MISALIGNED, "features_active": 0},
        ),
        ({"matches_slots": 1}, {"refused": Refusal.MATCHES_TOO_SMALL, "matches_active": 0}),
        ({"features_slot_pages": 0}, {"refused": Refusal.FEATURES_TOO_SMALL, "features_active": 0}),
        ({"matches_read": 9}, {"refused": Refusal.MATCHES_READ_AHEAD, "matches_active": 1}),
        ({"memory_mode": 1}, {"refused": Refusal.MEMORY_MODE, "features_active": 1}),
        ({"homographies_base_low": 1}, {"homographies_refused": RingFault.MISALIGNED}),
        ({"homographies_slots": 1}, {"homographies_refused": RingFault.TOO_SMALL}),
        ({"homographies_read": 9}, {"homographies_refused": RingFault.READ_AHEAD}),
    ]
    bench = ShellBench(reads=False)
    beats: list[Any] = []
    for change, refusal in changes:
        usual = {name: settings().get(name, 0) for name in change}
        beats += [change, *PAUSE[:8], *frame(0), refusal, usual, *PAUSE[:8]]
    run = bench.simulate(beats, clocks_after=10)
    assert bench.values["dropped"] == len(changes)
    assert bench.values["dropped_reason"] == Reason.REFUSED
    assert not run.emitted["features"]
    assert not bench.memory.bytes.any()


@pytest.mark.parametrize("stuck", [False, True])
def test_a_ring_is_active_until_nothing_of_it_is_being_written(stuck: bool) -> None:
    bench = ShellBench(seed=6)
    bench.memory.stuck = stuck
    off = {"enable": 0, "clear": 1, **{f"{ring}_enable": 0 for ring in RINGS}}
    told = {"clearing": int(stuck), **{f"{ring}_active": int(stuck) for ring in RINGS}}
    begins = [off, None, None, {"clear": 0, "clearing": 1}]
    bench.simulate([*frame(0), *PAUSE[:8], *begins, *PAUSE, *PAUSE, *PAUSE, told], clocks_after=1)
    # The first packet is under way, and `written` says nothing of it.
    assert len(bench.run.emitted["features"]) == 1
    assert not bench.run.delivered["features"] or not stuck


def test_a_ring_that_is_off_needs_no_slots() -> None:
    off: dict[str, Any] = {f"matches_{name}": 0 for name in ("enable", "slots", "slot_pages")}
    run = ShellBench(**off).simulate(list(flight(2)), clocks_after=100)
    assert [len(run.delivered[ring]) for ring in RINGS] == [2, 0, 2]


def test_no_more_frames_are_in_flight_than_can_be_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of an accelerator whose packets do not come, and rings that need no slots."""
    off: dict[str, Any] = {f"{ring}_enable": 0 for ring in RINGS}
    bench = ShellBench(**off)
    monkeypatch.setattr(bench, "_emit", lambda pixels, good: None)
    bench.simulate(list(flight(MAX_IN_FLIGHT + 2, gap=2)), clocks_after=40)
    assert (bench.values["dropped"], bench.values["dropped_reason"]) == (2, Reason.NO_BUFFER)


def test_a_packet_that_belongs_to_no_frame_takes_none_of_their_slots() -> None:
    bench = ShellBench(reads=False)
    bench._emit([0], good=0)
    run = bench.simulate([*PAUSE, *flight(SLOTS - 1)], clocks_after=200)
    assert bench.values["dropped"] == 0
    for ring in RINGS:
        assert [int(bench.slot(ring, n).header["number"]) for n in range(SLOTS)] == list(range(SLOTS))
        assert len(run.emitted[ring]) == SLOTS


def test_a_clear_forgets_the_frame_under_way_and_what_came_of_the_one_before() -> None:
    """Its number and slot are free again, and a packet that had no counterpart yet completes no other frame."""
    bench = ShellBench(reads=False, coalesce_count=SLOTS - 1)
    told: list[list[int]] = []

    async def watch(ctx: Any) -> None:
        written = [getattr(bench.registers, f"i_{ring}_written") for ring in RINGS]
        async for *_, ready in ctx.tick().sample(bench.registers.i_frames_ready):
            if ready:
                told.append([ctx.get(each) for each in written])

    # Only one output was as far as this.
    bench._packets["features"].append([1] * RECORD_WORDS["features"])
    half, clear = frame(0)[: 2 * WIDTH_PX], [{"clear": 1}, None, {"clear": 0}]
    beats = [*PAUSE, *half, *PAUSE, *clear, *PAUSE, *flight(SLOTS - 1)]
    bench.simulate(beats, clocks_after=250, others=[watch])
    for ring, first in (("features", 1), ("matches", 0), ("homographies", 0)):
        numbers = [int(bench.slot(ring, n).header["number"]) for n in range(first, first + SLOTS - 1)]
        assert numbers == list(range(2, SLOTS + 1))
    assert told == [[SLOTS, SLOTS - 1, SLOTS - 1]]


def test_no_homography_waits_for_a_memory_that_hangs() -> None:
    """The bench's sender of homographies does not accept a wait; the estimator would drop records."""
    bench = ShellBench(seed=8)
    bench.memory.stuck = True
    run = bench.simulate(list(flight(SLOTS + 1)), clocks_after=40)
    assert len(run.emitted["homographies"]) == SLOTS
    assert bench.values["dropped"] == 1


def test_error_responses_are_counted_and_no_damaged_packet_passes_for_whole() -> None:
    # By these seeds no two rings have an error in one clock, which would be one event.
    bench = ShellBench(seed=7, memory=memory(errors=60, seed=3))
    run = bench.simulate(list(flight(FRAMES)), clocks_after=250)
    assert 0 < run.events["memory_error"] == bench.memory.error_count
    for ring in RINGS:
        assert len(run.delivered[ring]) == len(run.emitted[ring])
        for sequence, (words, packet) in enumerate(zip(run.emitted[ring], run.delivered[ring], strict=True), 1):
            # A header that was refused leaves an old sequence number.
            is_whole = not packet.header["flags"] and packet.header["sequence"] == sequence
            assert not is_whole or packet.words.tolist() == words
    packets = [packet for ring in RINGS for packet in run.delivered[ring]]
    assert any(packet.header["flags"] == HeaderFlag.MEMORY_ERROR for packet in packets)


UNIT = [None] * 64
"""A pause of a tick, where one is this short."""
SHORT_PAUSES = [beat for number in range(8) for beat in (*frame(number), *UNIT)]
"""A pause for each place of a tick in it."""


@pytest.mark.parametrize(
    ("settings", "beats", "stopped", "stops"),
    [
        ({"camera_timeout": 1}, SHORT_PAUSES, 0, 0),
        ({"camera_timeout": 1}, 2 * UNIT, 1, 1),
        ({"camera_timeout": 0}, 2 * UNIT, 0, 0),
        ({"camera_timeout": 1, "enable": 0}, 2 * UNIT, 1, 0),
        ({"camera_timeout": 9}, [*3 * UNIT, {"camera_stopped": 0, "camera_timeout": 1}, *UNIT], 1, 1),
    ],
    ids=["short pauses", "a long one", "never", "nobody asks", "shortened meanwhile"],
)
def test_a_pause_longer_than_the_timeout_is_a_stop(
    monkeypatch: pytest.MonkeyPatch, settings: dict[str, Any], beats: list[Any], stopped: int, stops: int
) -> None:
    monkeypatch.setattr("hdl.shell.shell.TICK_CLOCKS", len(UNIT))
    bench = ShellBench(camera_s=SYNC_S, **settings)
    run = bench.simulate([*frame(0), *beats, *PAUSE[:8], {"camera_stopped": stopped}, None], clocks_after=1)
    assert run.events["camera_stops"] == stops


def test_a_camera_that_stops_and_resumes_makes_one_bad_frame() -> None:
    whole, half = frame(1), frame(2)[: WIDTH_PX * 2 + 3]
    bench = ShellBench(camera_timeout=1, coalesce_count=255, coalesce_timeout=1, camera_s=2e-8)
    # In the first pause two ticks pass, in the second one.
    tick = [None] * (TICK_CLOCKS // 2 + 3)
    stops = [*tick, *tick, {"camera_stopped": 1}, *whole, {"camera_stopped": 0}]
    run = bench.simulate([*frame(0), *PAUSE, *half, *stops, *tick, *half, *whole], clocks_after=200)
    check(bench, run, whole=5)
    assert bench.values["cut"] == 2
    assert run.events["camera_stops"] == 1
    # Frames were told of during the pauses, by their time limit.
    assert run.events["frames_ready"] == 2
    good = [int(packet.header["status"]) >> 8 & 1 for packet in run.delivered["matches"]]
    assert good == [1, 0, 1, 0, 1]


def test_a_camera_that_changes_size_gives_no_wrong_frame() -> None:
    wide, tall, small = frame(1, width=10), frame(2, height=HEIGHT_PX + 2), frame(3, width=6)
    parts = [frame(0), wide, small, frame(4), tall, tall, frame(5), frame(6)]
    bench = ShellBench()
    run = bench.simulate([beat for part in parts for beat in (*part, *PAUSE)], clocks_after=100)
    check(bench, run)
    # Of a frame with more lines the upper ones are right; the frames after it are dropped until the size is.
    numbers = [int(packet.header["number"]) for packet in run.delivered["features"] if packet.header["status"] >> 8 & 1]
    assert numbers == [1, 4, 5, 8]
    assert bench.values["cut"] == 2
    assert bench.values["dropped"] == 2
    assert bench.values["dropped_reason"] == Reason.TOO_LARGE


def test_an_accelerator_that_hangs_costs_frames_and_not_the_camera() -> None:
    bench = ShellBench(seed=1, busy=254, camera_s=0.9e-8)
    bench.simulate(list(flight(FRAMES, gap=2)), clocks_after=10)
    # The last pixels are still on their way.
    assert bench.values["camera_frames"] >= FRAMES - 2
    assert bench.values["dropped"] + bench.values["cut"] >= FRAMES - 3
    assert bench.values["dropped_reason"] == Reason.OUTRUN


def test_pixels_lost_in_the_crossing_cost_their_frames() -> None:
    """A camera with a clock twice as fast as the design's: the queue overflows, and nothing wrong comes through."""
    bench = ShellBench(seed=2, camera_s=0.4e-8, camera_depth=32)
    frames = [beat for number in range(8) for beat in frame(number)]
    run = bench.simulate([*frames, *[None] * 300, *frame(8), *PAUSE], clocks_after=200)
    check(bench, run)
    assert bench.values["dropped"] + bench.values["cut"] > 3
    assert int(run.delivered["matches"][-1].header["number"]) == 9


class PaintingStandIn(wiring.Component):
    """The ports of the painter in its shell; it takes every record."""

    def __init__(self) -> None:
        super().__init__(Painting(registers=registers()).signature)

    def elaborate(self, platform: object) -> Module:
        m = Module()
        m.d.comb += self.i_homographies.ready.eq(1)
        return m


@pytest.mark.parametrize("camera_s", [0.97e-8, pytest.param(2.3e-8, marks=pytest.mark.slow)])
def test_a_slow_memory_and_a_busy_accelerator_lose_nothing_unsaid(camera_s: float) -> None:
    """And the painter sees what the accelerator and the ring take."""
    painting: Any = PaintingStandIn()
    frames: list[list[int]] = []
    words: list[int] = []

    async def watch(ctx: Any) -> None:
        record, beat = painting.i_homographies, painting.i
        async for *_, valid, pixel, taken, word in ctx.tick().sample(
            painting.i_valid, beat, record.valid, record.payload.data
        ):
            if valid and pixel.first:
                frames.append([])
            if valid:
                frames[-1].append(pixel.data)
            if taken:
                words.append(word)

    rules = memory(waits=90, latency_clocks=25, seed=3)
    bench = ShellBench(seed=3, memory=rules, camera_s=camera_s, busy=40, painting=painting)
    run = bench.simulate(list(flight(5, seed=4)), clocks_after=1000, others=[watch])
    check(bench, run)
    assert len(run.delivered["matches"]) == len(run.emitted["matches"]) >= 3
    assert run.events["frames_ready"] == len(run.emitted["matches"])
    packets = run.delivered["homographies"]
    assert frames == [run.sent[int(packet.header["number"])] for packet in packets]
    assert words == [word for packet in run.emitted["homographies"] for word in packet]


def test_a_clear_waits_for_the_painter() -> None:
    painting: Any = PaintingStandIn()
    clearing = []

    async def paint(ctx: Any) -> None:
        """Become idle long after the rings."""
        while not ctx.get(painting.i_stop):
            await ctx.tick()
        await ctx.tick().repeat(300)
        clearing.append(ctx.get(bench.registers.i_clearing))
        ctx.set(painting.o_idle, 1)
        await ctx.tick().repeat(3)
        clearing.append(ctx.get(bench.registers.i_clearing))

    bench = ShellBench(painting=painting)
    clear = [{"clear": 1}, None, {"clear": 0}]
    run = bench.simulate([*frame(0), *PAUSE, *clear, *frame(1)], clocks_after=400, others=[paint])
    assert clearing == [1, 0]
    # The frame that came meanwhile is none that is reported.
    assert (bench.values["dropped"], bench.values["dropped_reason"]) == (1, Reason.OFF)
    assert (len(run.emitted["features"]), run.events["frame_dropped"]) == (1, 0)


def test_the_memory_notices_a_broken_rule() -> None:
    """What the other tests rely on."""
    bench = ShellBench(memory=AxiMemory(BASES["features"], PAGE_BYTES))
    with pytest.raises(AssertionError, match="is outside"):
        bench.simulate(list(flight(1)), clocks_after=200)
