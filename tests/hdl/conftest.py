import gc
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import pytest
from amaranth import Elaboratable, Module, Mux, Signal, Value
from amaranth.lib import wiring
from amaranth.lib.memory import Memory
from amaranth.sim import Simulator
from numpy.typing import NDArray

from hdl.lib.delay import delayed
from hdl.lib.line_memory import LineMemory
from sim.benches import drivers
from sim.benches.drivers import Beats, run_beats
from sim.simulators.recording import Pauses
from tests.hdl import block_bench

SHAPE = (15, 19)


def elaborate_with_collisions(memory: LineMemory, _platform: object) -> Module:
    """A `LineMemory` that inverts a word that is read while it is written, where block RAMs return anything."""
    m = Module()
    words: Memory
    m.submodules.memory = words = Memory(shape=memory.shape, depth=memory.depth, init=[])
    read, write = words.read_port(), words.write_port()
    m.d.comb += [
        read.addr.eq(memory.i_read_address),
        read.en.eq(memory.i_read),
        write.addr.eq(memory.i_write_address),
        write.en.eq(memory.i_write),
        write.data.eq(memory.i_word),
    ]
    load = memory.i_load if memory.loads else delayed(m, memory.i_read, 1, reset_less=False)
    # A word leaves once: some block RAMs are read again meanwhile, anywhere.
    collides = Signal()
    with m.If(load):
        m.d.sync += collides.eq(1)
    with m.If(memory.i_read):
        m.d.sync += collides.eq(memory.i_write & (memory.i_read_address == memory.i_write_address))
    read_word, word = Signal.like(Value.cast(read.data)), Signal.like(Value.cast(read.data), reset_less=True)
    with m.If(load):
        m.d.sync += word.eq(Mux(collides, ~read_word, read_word))
    m.d.comb += [read_word.eq(read.data), Value.cast(memory.o_word).eq(word)]
    return m


@pytest.fixture(autouse=True)
def collisions(monkeypatch: pytest.MonkeyPatch) -> None:
    """No block relies on what a block RAM reads while it is written; the Verilog stays as it is."""

    def simulator(dut: Elaboratable) -> Simulator:
        with monkeypatch.context() as patched:
            patched.setattr(LineMemory, "elaborate", elaborate_with_collisions)
            return Simulator(dut)

    for module in (block_bench, drivers):
        monkeypatch.setattr(module, "Simulator", simulator)


@pytest.fixture
def unused_blocks(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Amaranth does not complain about blocks that were made before a larger one was refused."""
    monkeypatch.setattr(Elaboratable, "_MustUse__silence", True)
    yield
    gc.collect()


@pytest.fixture
def pauses() -> Pauses:
    """Beats that follow each other without a gap, up to a dozen, and gaps of one and more clocks."""
    return Pauses(gaps=60, seed=7)


@pytest.fixture
def gray_frames() -> list[NDArray[np.uint8]]:
    """Frames of different content, with the extremes, at an odd size."""
    noise = np.random.default_rng(11).integers(0, 256, (2, *SHAPE), dtype=np.uint8)
    y, x = np.indices(SHAPE)
    white_and_black = np.where(x < 10, 255, 0).astype(np.uint8)
    white_and_black[9, 16] = 255
    checkerboard = ((x + y) % 2 * 255).astype(np.uint8)
    steps = np.where((x // 4 + y // 4) % 2, noise[1] // 16, 255 - noise[1] // 16).astype(np.uint8)
    return [noise[0], white_and_black, checkerboard, steps]


@pytest.fixture
def run_block(pauses: Pauses) -> Callable[..., list[Beats]]:
    """Send frames through a block that answers each beat after ``latency_cycles``; returns its answers by frame."""

    def run(
        dut: wiring.Component,
        frames: Sequence[Mapping[str, NDArray[Any]]],
        settings: Mapping[str, int] | None = None,
    ) -> list[Beats]:
        sent, received = run_beats(dut, frames, settings=settings, pauses=pauses)
        np.testing.assert_array_equal(received.cycles - sent.cycles, dut.latency_cycles)
        return received.split()

    return run


@pytest.fixture
def check_block(run_block: Callable[..., list[Beats]]) -> Callable[..., None]:
    """Compare fields of a block's answers with one plane for each frame, except in a margin of ``margin_px``."""

    def check(
        dut: wiring.Component,
        frames: Sequence[Mapping[str, NDArray[Any]]],
        expected: Mapping[str, Sequence[NDArray[Any]]],
        *,
        margin_px: int = 0,
        settings: Mapping[str, int] | None = None,
    ) -> None:
        parts = run_block(dut, frames, settings)
        for field, planes in expected.items():
            for number, (part, plane) in enumerate(zip(parts, planes, strict=True)):
                inside = tuple(slice(margin_px, side - margin_px) for side in plane.shape)
                actual = part.plane(field, plane.shape, lag_px=getattr(dut, "lag_px", 0))
                np.testing.assert_array_equal(actual[inside], plane[inside], f"{field} of frame {number}")

    return check


@pytest.fixture(params=[1, 2], ids=["one_pixel", "two_pixels"])
def rate(request: pytest.FixtureRequest) -> dict[str, int]:
    """Parameters of a block: pixels of a beat."""
    return {"pixels_per_clock": request.param}
