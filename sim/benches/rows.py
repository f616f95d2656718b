"""Runs a row, a block with its vectors: whatever pauses, and whatever was under way at a reset, its answers are exact.

A row is a `hdl.blocks.vectors.Block`: a component, what is sent to it, and what it answers. One run sends a part of it
with gaps and stalls, resets the block in its middle, and then sends all: beats with gaps again, a stream without.
Answers come after ``latency_cycles``, the first of a stream where nobody waits.
"""

import random
from collections.abc import Sequence
from itertools import accumulate
from typing import Any

from amaranth import Cat, ResetInserter, Signal, Value
from amaranth.lib import data
from amaranth.sim import Simulator

from hdl.blocks.flat import leaves
from hdl.blocks.vectors import Block, Row
from sim.simulators.recording import NO_PAUSES, Pauses

CLOCK_S = 1e-8
DRAIN_CYCLES = 64
"""Clocks after the last answer."""
PAUSES = Pauses(gaps=60, stalls=120, seed=7)


class _Port:
    """A stream, a beat or a channel of AXI: its fields in one word, its rows, and the clocks of what has passed."""

    def __init__(self, dut: Any, name: str, number: int, expected: Sequence[Row]) -> None:
        self.name, self.number, members = name, number, dut.signature.members
        fields: Any
        self.word: Value
        self.is_stream = name not in members or members[name].is_signature
        if name not in members:
            bus, _, channel = name.rpartition("_")
            interface, handshake = getattr(dut, bus), {f"{channel}valid", f"{channel}ready"}
            parts = interface.signature.members.items()
            shapes = {each: part.shape for each, part in parts if each.startswith(channel) and each not in handshake}
            self.word, fields = Cat(getattr(interface, each) for each in shapes), leaves(bus, data.StructLayout(shapes))
            self.valid, self.ready = (getattr(interface, f"{channel}{each}") for each in ("valid", "ready"))
        else:
            port = getattr(dut, name)
            payload = port.payload if self.is_stream else port
            self.word, fields = Value.cast(payload), leaves(name, payload.shape())
            self.valid, self.ready = port.valid, port.ready if self.is_stream else Signal()
        self.places = {leaf: (low, (1 << shape.width) - 1) for leaf, low, shape in fields}
        self.rows = expected
        self.words = [self._pack(row) for row in expected]
        self.begin([])

    def _pack(self, row: Row) -> int:
        places = ((self.places[name], value) for name, value in row.items())
        return sum((value & mask) << low for (low, mask), value in places)

    def begin(self, words: list[int]) -> None:
        self.left, self.offered, self.bits = words[::-1], False, 0
        self.waits: int | None = None
        self.begins, self.cycles = list[int](), list[int]()

    def offer(self, cycle: int, pauses: Pauses, garbage: random.Random, spacing_cycles: int) -> None:
        """Of an input: the next word, unless one waits already."""
        late = not self.cycles or cycle - self.cycles[-1] >= spacing_cycles
        if not self.offered:
            self.offered = bool(self.left) and late and not pauses.gap(cycle, self.number)
            self.bits = self.left[-1] if self.offered else garbage.getrandbits(len(self.word))
            if self.offered:
                self.begins.append(cycle)

    def pass_on(self, cycle: int, ready: int) -> None:
        """Of an input: what was offered has been taken, or waits."""
        if self.offered and (ready or not self.is_stream):
            self.left.pop()
            self.cycles.append(cycle)
            self.offered = False

    def take(self, cycle: int, valid: int, word: int, ready: bool) -> None:
        """Of an output: compare what comes with the next row, where that says something."""
        assert self.waits is None or (valid and word == self.waits), "what waits is withdrawn or changed"
        self.waits = word if valid and self.is_stream and not ready else None
        if not valid or self.waits is not None:
            return
        number = len(self.cycles)
        assert number < len(self.rows), "more answers than inputs"
        found = {name: word >> low & mask for name, (low, mask) in self.places.items()}
        row = {name: value & self.places[name][1] for name, value in self.rows[number].items()}
        assert {name: found[name] for name in row} == row, f"answer {number}"
        self.cycles.append(cycle)


class _Bench:
    """A block in the simulator, clock by clock."""

    def __init__(self, block: Block) -> None:
        self.block, self.dut = block, block.component
        streams = (*block.inputs.items(), *block.outputs.items())
        ports = [_Port(self.dut, name, n, each) for n, (name, each) in enumerate(streams)]
        self.sources, self.sinks = ports[: len(block.inputs)], ports[len(block.inputs) :]
        self.reset, self.cycle, self.garbage = Signal(), 0, random.Random(3)
        self.seen = [port.ready for port in self.sources] + [v for port in self.sinks for v in (port.valid, port.word)]
        driven = [each for port in self.sources for each in (port.word, port.valid)]
        driven += [port.ready for port in self.sinks if port.is_stream]
        self.driven, self.lows = Cat(driven), [0, *accumulate(map(len, driven))][:-1]

    async def run(self, ctx: Any) -> None:
        self._set(ctx)
        waits = any(port.is_stream for port in self.sources) and not self.block.remembers
        await self._send(ctx, 0.4 if waits else 0.13, PAUSES)
        for reset in (1, 0):
            ctx.set(Cat(self.reset, (port.valid for port in self.sources)), reset)
            # The second clock is that in which it becomes ready.
            await ctx.tick()
        await self._send(ctx, 1, NO_PAUSES if waits else PAUSES)
        self._check_times()

    def _set(self, ctx: Any) -> None:
        for name, member in self.dut.signature.members.items():
            if not member.is_signature:
                for leaf, low, shape in leaves(name, member.shape):
                    if leaf in self.block.settings:
                        bits = Value.cast(getattr(self.dut, name))[low : low + shape.width]
                        ctx.set(bits, self.block.settings[leaf] & (1 << shape.width) - 1)

    async def _send(self, ctx: Any, part: float, pauses: Pauses) -> None:
        """Send all, or the first inputs, and take the answers until all have come, or the last input has gone."""
        for port in self.sources:
            is_whole = self.block.in_turn and port is not self.sources[-1]
            port.begin(port.words[: max(1, round((1 if is_whole else part) * len(port.words)))])
        for port in self.sinks:
            port.begin([])
        idle = drained = 0
        readies = self._drive(ctx, pauses)
        async for _, _, *values in ctx.tick().sample(*self.seen):
            before = self._count()
            for port, ready in zip(self.sources, values, strict=False):
                port.pass_on(self.cycle, ready)
            answers = iter(values[len(self.sources) :])
            for port, ready in zip(self.sinks, readies, strict=True):
                port.take(self.cycle, next(answers), next(answers), ready)
            self.cycle += 1
            idle = 0 if self._count() > before else idle + 1
            answered = part < 1 or all(len(port.cycles) == len(port.rows) for port in self.sinks)
            drained += answered and not any(port.left for port in self.sources)
            # Words may wait for a burst that the first part has not.
            drained += part < 1 and self.block.remembers and idle == self.block.idle_cycles
            assert idle <= self.block.idle_cycles, f"no more answers in clock {self.cycle}"
            if drained >= (DRAIN_CYCLES if part == 1 else 1):
                break
            readies = self._drive(ctx, pauses)

    def _drive(self, ctx: Any, pauses: Pauses) -> list[bool]:
        """Set the inputs for the next clock; returns which outputs are taken in it."""
        turn = next((n for n, port in enumerate(self.sources) if port.left), len(self.sources))
        for port in self.sources[: turn + 1] if self.block.in_turn else self.sources:
            port.offer(self.cycle, pauses, self.garbage, self.block.spacing_cycles)
        readies = [not pauses.stall(self.cycle, port.number) for port in self.sinks]
        values = [bits for port in self.sources for bits in (port.bits, port.offered)]
        values += [ready for port, ready in zip(self.sinks, readies, strict=True) if port.is_stream]
        # Each set lets the whole block settle: one for all.
        ctx.set(self.driven, sum(bits << low for bits, low in zip(values, self.lows, strict=True)))
        return readies

    def _count(self) -> int:
        return sum(len(port.cycles) for port in (*self.sources, *self.sinks))

    def _check_times(self) -> None:
        """Of all that was sent."""
        begins, answered = self.sources[-1 if self.block.in_turn else 0].begins, self.sinks[0].cycles
        latency_cycles = getattr(self.dut, "latency_cycles", None)
        if self.sinks[0].is_stream:
            assert self.block.remembers or latency_cycles is None or answered[0] - begins[0] == latency_cycles
        elif latency_cycles is not None:
            # Not every beat has an answer.
            assert {cycle - latency_cycles for cycle in answered} <= set(begins)
            assert len(answered) < len(begins) or answered[0] - begins[0] == latency_cycles
        if self.block.clocks_each:
            assert answered[-1] - answered[0] == self.block.clocks_each * (len(answered) - 1)


def check(block: Block) -> None:
    """Run a block with its vectors in Amaranth's simulator.

    Raises
    ------
    AssertionError
        If an answer is wrong, missing or too many, comes at another time, or changes while it waits.
    """
    _simulator(_Bench(block)).run()


def record(block: Block, clocks: int) -> dict[str, list[int]]:
    """Record the ports of a block in the first clocks of the run that `check` makes, with gaps and stalls.

    Returns
    -------
    dict
        For each port, by its flat name, its value in each clock.

    Raises
    ------
    AssertionError
        As by `check`, from what is recorded.
    """
    bench = _Bench(block)
    ports: dict[str, Value] = {}
    for port in (*bench.sources, *bench.sinks):
        ports |= {f"{port.name}_valid": port.valid} | ({f"{port.name}_ready": port.ready} if port.is_stream else {})
        ports |= {leaf: port.word[low : low + mask.bit_length()] for leaf, (low, mask) in port.places.items()}
    seen: list[Sequence[int]] = []

    async def watch(ctx: Any) -> None:
        async for _, _, *values in ctx.tick().sample(*ports.values()):
            seen.append(values)

    simulator = _simulator(bench)
    simulator.add_testbench(watch, background=True)
    simulator.run_until(clocks * CLOCK_S)
    return dict(zip(ports, map(list, zip(*seen, strict=True)), strict=True))


def _simulator(bench: _Bench) -> Simulator:
    simulator = Simulator(ResetInserter(bench.reset)(bench.dut))
    simulator.add_clock(CLOCK_S)
    simulator.add_testbench(bench.run)
    return simulator
