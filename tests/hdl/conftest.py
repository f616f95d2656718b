import gc
from collections.abc import Iterator

import pytest
from amaranth import Elaboratable, Module, Mux, Signal, Value
from amaranth.lib.memory import Memory
from amaranth.sim import Simulator

from hdl.lib.delay import delayed
from hdl.lib.line_memory import LineMemory
from sim.benches import rows
from tests.hdl import block_bench


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

    for module in (block_bench, rows):
        monkeypatch.setattr(module, "Simulator", simulator)


@pytest.fixture
def unused_blocks(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Amaranth does not complain about blocks that were made before a larger one was refused."""
    monkeypatch.setattr(Elaboratable, "_MustUse__silence", True)
    # What was there before is not looked at: in a long run that takes seconds.
    gc.freeze()
    yield
    gc.collect()
    gc.unfreeze()
