"""The shell in Amaranth's simulator, between a camera, an accelerator and a host that are written in Python."""

import random
from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any

import numpy as np
from amaranth import ClockDomain, Module, Signal
from amaranth.hdl import Elaboratable
from amaranth.sim import Simulator

from golden_model.records import WORD_BYTES, Tag
from hdl.registers.register_map import Access, fields
from hdl.registers.shell_register_map import ALL_REGISTERS
from hdl.settings import PAGE_BYTES
from hdl.shell.painting import Painting
from hdl.shell.shell import Shell
from hdl.shell.slot import HEADER, HEADER_BYTES
from tests.hdl.block_bench import Testbench
from tests.hdl.shell.axi_memory import AxiMemory

WIDTH_PX, HEIGHT_PX = 8, 4
RECORD_WORDS = {"features": 3, "matches": 2, "homographies": 4}
MAX_RECORDS = {"features": 40, "matches": 40, "homographies": 1}
SLOTS = 4
RINGS = ("features", "matches", "homographies")
BASES = {ring: 0x9_1000_0000 + n * SLOTS * PAGE_BYTES for n, ring in enumerate(RINGS)}
SYNC_S = 1e-8
CHECKED = ("refused", "homographies_refused", "clearing", "camera_stopped", *(f"{ring}_active" for ring in RINGS))
"""Fields that only the shell sets."""

Beat = tuple[int, int, int] | dict[str, int] | None
"""A pixel (data, first, last), values of registers to set or to check, or a clock without a pixel."""


@dataclass
class Delivered:
    """A packet that the host found in a ring."""

    header: np.void
    words: np.ndarray


@dataclass
class Run:
    """What happened in a simulation.

    ``sent`` has for each frame of the camera its number and its pixels; ``emitted`` for each ring the packets of the
    accelerator; ``delivered`` those that the host has read.
    """

    sent: dict[int, list[int]] = field(default_factory=dict)
    emitted: dict[str, list[list[int]]] = field(default_factory=lambda: {ring: [] for ring in RINGS})
    delivered: dict[str, list[Delivered]] = field(default_factory=lambda: {ring: [] for ring in RINGS})
    events: dict[str, int] = field(default_factory=dict)


def registers(**values: int) -> Any:
    """The signals of the register file, which the testbench sets."""
    found = SimpleNamespace()
    for each in fields(*Access, registers=ALL_REGISTERS):
        setattr(found, f"i_{each.name}", Signal(each.bits, name=f"i_{each.name}"))
        setattr(
            found, f"o_{each.name}", Signal(each.bits, name=f"o_{each.name}", init=values.get(each.name, each.init))
        )
    return found


def settings(**changes: int) -> dict[str, int]:
    """Rings that work, and a camera that is on."""
    rings = {
        f"{ring}_{name}": value
        for ring in RINGS
        for name, value in (
            ("base_low", BASES[ring] & 0xFFFF_FFFF),
            ("base_high", BASES[ring] >> 32),
            ("slots", SLOTS),
            ("slot_pages", 1),
            ("enable", 1),
        )
    }
    return {"width_px": WIDTH_PX, "height_px": HEIGHT_PX, "enable": 1, **rings} | changes


def frame(number: int, width: int = WIDTH_PX, height: int = HEIGHT_PX) -> list[tuple[int, int, int]]:
    """A frame's pixels: data, first, last."""
    return [((number * 16 + n) & 0xFF, int(n == 0), int(n % width == width - 1)) for n in range(width * height)]


class _Top(Elaboratable):
    def __init__(self, shell: Shell) -> None:
        self.shell = shell

    def elaborate(self, platform: object) -> Module:
        m = Module()
        m.domains.camera = ClockDomain()
        m.submodules.shell = self.shell
        return m


class ShellBench:
    """Runs the shell with a camera, a stub of the accelerator, memory and a host.

    Parameters
    ----------
    seed : int
    memory : AxiMemory, optional
    camera_s : float
        Period of the camera's clock.
    busy : int
        0..255: how often, in 1/256, the stub takes no pixel.
    reads : bool
        Whether the host reads what is delivered.
    painting : Painting, optional
        Beside the accelerator.
    **changes : int
        Values of register fields.
    """

    def __init__(
        self,
        *,
        seed: int = 0,
        memory: AxiMemory | None = None,
        camera_s: float = 1.3e-8,
        busy: int = 0,
        reads: bool = True,
        camera_depth: int = 64,
        painting: Painting | None = None,
        **changes: int,
    ) -> None:
        self.registers = registers(**settings(**changes))
        self.memory = memory or AxiMemory(BASES["features"], len(RINGS) * SLOTS * PAGE_BYTES, seed=seed)
        self.camera_s, self.busy, self.reads = camera_s, busy, reads
        self.random = random.Random(seed)
        self.shell = Shell(
            registers=self.registers,
            record_words=RECORD_WORDS,
            max_words={ring: MAX_RECORDS[ring] * RECORD_WORDS[ring] for ring in RINGS},
            video_bits=8,
            camera_depth=camera_depth,
            fifo_words=64,
            painting=painting,
        )
        self.run = Run()
        self.values: dict[str, int] = {}
        self._packets: dict[str, deque[list[int]]] = {ring: deque() for ring in RINGS}

    def simulate(self, beats: Sequence[Beat], *, clocks_after: int, others: Sequence[Testbench] = ()) -> Run:
        """Send beats, and run on for a while, with other testbenches beside."""
        simulator = Simulator(_Top(self.shell))
        simulator.add_clock(SYNC_S, domain="sync")
        simulator.add_clock(self.camera_s, phase=0.37 * self.camera_s, domain="camera")

        async def camera(ctx: Any) -> None:
            number, valid = 0, False
            for beat in beats:
                if isinstance(beat, dict):
                    self._access(ctx, beat)
                    continue
                if valid != (beat is not None):
                    valid = beat is not None
                    ctx.set(self.shell.i_camera_valid, valid)
                if beat is not None:
                    pixel, first, last = beat
                    ctx.set(self.shell.i_camera.as_value(), pixel | first << 32 | last << 33)
                    if first:
                        number += 1
                        self.run.sent[number] = []
                    self.run.sent.setdefault(number, []).append(pixel)
                await ctx.tick("camera")
            ctx.set(self.shell.i_camera_valid, 0)
            await ctx.tick("sync").repeat(clocks_after)
            names = "camera_frames", "dropped", "cut", "refused", "dropped_reason"
            self.values = {name: ctx.get(getattr(self.registers, f"i_{name}")) for name in names}

        simulator.add_testbench(camera)
        for other in others:
            simulator.add_testbench(other, background=True)
        for ring in RINGS:
            simulator.add_testbench(self.memory.port(getattr(self.shell, ring)), background=True)
            simulator.add_testbench(self._sender(ring), background=True)
            simulator.add_testbench(self._host(ring), background=True)
        simulator.add_testbench(self._accelerator, background=True)
        simulator.add_testbench(self._events, background=True)
        simulator.run()
        return self.run

    def _access(self, ctx: Any, values: dict[str, int]) -> None:
        """Set registers, or check those that only the shell sets."""
        for name, value in values.items():
            if name in CHECKED:
                assert ctx.get(getattr(self.registers, f"i_{name}")) == value
            else:
                ctx.set(getattr(self.registers, f"o_{name}"), value)

    async def _accelerator(self, ctx: Any) -> None:
        """Takes pixels; makes a good frame of whole ones, and a bad one of a frame that the next one cuts off.

        A clear drops the frame under way.
        """
        video, under_way, ready = self.shell.o_video, False, False
        pixels: list[Any] = []

        def drive() -> bool:
            now = self.random.randrange(256) >= self.busy
            if now != ready:
                ctx.set(video.ready, now)
            return now

        ready = drive()
        sampled = (video.valid, video.payload, self.registers.o_clear)
        async for *_, valid, payload, clear in ctx.tick("sync").sample(*sampled):
            under_way &= not clear
            if valid and ready:
                if payload.first:
                    if under_way:
                        self._emit(pixels, good=0)
                    pixels, under_way = [], True
                pixels.append(payload.data)
                if under_way and len(pixels) == WIDTH_PX * HEIGHT_PX:
                    self._emit(pixels, good=1)
                    under_way = False
            ready = drive()

    def _emit(self, pixels: list[int], *, good: int) -> None:
        """A packet for each ring: records that tell the pixels, then a status; a homography is such a last record."""
        for ring in RINGS:
            count = self.random.randrange(max(MAX_RECORDS[ring] - 1, 1)) if good else 0
            words = [pixels[n % len(pixels)] << 16 | n << 32 | Tag.FEATURE for n in range(count * RECORD_WORDS[ring])]
            words += [good << 8 | Tag.FRAME_STATUS | pixels[0] << 32, *[0] * (RECORD_WORDS[ring] - 1)]
            self.run.emitted[ring].append(words)
            self._packets[ring].append(words)

    def _sender(self, ring: str) -> Any:
        async def testbench(ctx: Any) -> None:
            port, packets = getattr(self.shell, f"i_{ring}"), self._packets[ring]
            while True:
                if not packets:
                    await ctx.tick("sync")
                    continue
                words = packets.popleft()
                ctx.set(port.valid, 1)
                for n, word in enumerate(words):
                    ctx.set(port.payload.as_value(), word | (n == len(words) - 1) << 64)
                    taken = False
                    while not taken:
                        *_, taken = await ctx.tick("sync").sample(port.ready)
                        assert taken or ring != "homographies", "the estimator would drop the next record"
                ctx.set(port.valid, 0)

        return testbench

    def _host(self, ring: str) -> Any:
        written, read = getattr(self.registers, f"i_{ring}_written"), getattr(self.registers, f"o_{ring}_read")

        async def testbench(ctx: Any) -> None:
            count = 0
            async for _ in ctx.tick("sync"):
                if self.reads and ctx.get(written) > count:
                    self.run.delivered[ring].append(self.slot(ring, count))
                    count += 1
                    ctx.set(read, count)

        return testbench

    def slot(self, ring: str, number: int) -> Delivered:
        """The packet of a ring, as it is in memory."""
        offset = BASES[ring] - self.memory.base + number % SLOTS * PAGE_BYTES
        slot = self.memory.bytes[offset : offset + PAGE_BYTES]
        header = slot[: HEADER.itemsize].view(HEADER)[0].copy()
        words = slot[HEADER_BYTES : HEADER_BYTES + int(header["length_bytes"])].view(f"<u{WORD_BYTES}").copy()
        return Delivered(header, words)

    async def _events(self, ctx: Any) -> None:
        names = ("frames_ready", "frame_dropped", "camera_stops", "memory_error")
        signals = [getattr(self.registers, f"i_{name}") for name in names]
        async for _, _, *values in ctx.tick("sync").sample(*signals):
            for name, value in zip(names, values, strict=True):
                self.run.events[name] = self.run.events.get(name, 0) + value


def flight(frames: int, *, gap: int = 40, seed: int = 0) -> Iterator[tuple[int, int, int] | None]:
    """Whole frames with pauses between lines and frames, which jitter."""
    rng = random.Random(seed)
    for number in range(frames):
        for beat in frame(number):
            yield beat
            if beat[2]:
                yield from [None] * rng.randrange(6)
        yield from [None] * rng.randrange(gap, 2 * gap)
