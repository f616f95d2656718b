"""Runs a row, a block with its vectors: whatever pauses, and whatever was under way at a reset, its answers are exact.

A row is what `hdl.blocks.vectors.Block` says: how a block is made, what is sent to it, and what it answers. One run
sends a part of it with gaps and stalls, resets the block in its middle, and then sends all: beats with gaps again, a
stream without. Answers come after ``latency_cycles``, the first of a stream where nobody waits.
"""

import random
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from amaranth import Cat, ResetInserter, Signal, Value
from amaranth.sim import Simulator

from hdl.blocks.flat import leaves
from hdl.blocks.vectors import Block
from hdl.blocks.vectors import Row as Fields
from sim.simulators.recording import NO_PAUSES, Pauses

CLOCK_S = 1e-8
DRAIN_CYCLES = 64
"""Clocks after the last answer."""
PAUSES = Pauses(gaps=60, stalls=120, seed=7)


class Row(NamedTuple):
    """A row of a table of blocks."""

    make: Callable[[], Block]
    clocks_each: int | None = None
    """Clocks from one answer to the next of a stream that nobody stalls."""
    idle_cycles: int = 2048
    """Clocks after which a block that does not answer has failed."""
    remembers: bool = False
    """A stream whose packets count as a whole: all of them meet gaps and stalls, and its latency is not checked."""


class _Port:
    """A stream or a beat: its fields in one word, what is sent or expected there, and the clocks of what has passed."""

    def __init__(self, dut: Any, name: str, number: int, expected: Sequence[Fields]) -> None:
        port, self.name, self.number = getattr(dut, name), name, number
        self.is_stream = dut.signature.members[name].is_signature
        data = port.payload if self.is_stream else port
        self.word, self.valid, self.ready = Value.cast(data), port.valid, port.ready if self.is_stream else Signal()
        self.places = {leaf: (low, (1 << shape.width) - 1) for leaf, low, shape in leaves(name, data.shape())}
        self.rows = expected
        self.words = [self._pack(row) for row in expected]
        self.begin([])

    def _pack(self, row: Fields) -> int:
        places = ((self.places[name], value) for name, value in row.items())
        return sum((value & mask) << low for (low, mask), value in places)

    def begin(self, words: list[int]) -> None:
        self.left, self.offered = words[::-1], False
        self.waits: int | None = None
        self.begins, self.cycles = list[int](), list[int]()

    def offer(self, ctx: Any, cycle: int, pauses: Pauses, garbage: random.Random, spacing_cycles: int) -> None:
        """Of an input: the next word, unless one waits already."""
        late = not self.cycles or cycle - self.cycles[-1] >= spacing_cycles
        if not self.offered:
            self.offered = bool(self.left) and late and not pauses.gap(cycle, self.number)
            if self.offered:
                ctx.set(self.word, self.left[-1])
                self.begins.append(cycle)
            else:
                ctx.set(self.word, garbage.getrandbits(len(self.word)))
        ctx.set(self.valid, self.offered)

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
    """A row's block in the simulator, clock by clock."""

    def __init__(self, row: Row) -> None:
        self.row, self.block = row, row.make()
        self.dut: Any = self.block.component
        streams = (*self.block.inputs.items(), *self.block.outputs.items())
        ports = [_Port(self.dut, name, n, each) for n, (name, each) in enumerate(streams)]
        self.sources, self.sinks = ports[: len(self.block.inputs)], ports[len(self.block.inputs) :]
        self.reset, self.cycle, self.garbage = Signal(), 0, random.Random(3)

    async def run(self, ctx: Any) -> None:
        self._set(ctx)
        waits = any(port.is_stream for port in self.sources) and not self.row.remembers
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
            port.begin(port.words[: max(1, round(part * len(port.words)))])
        for port in self.sinks:
            port.begin([])
        idle = drained = 0
        while drained < (DRAIN_CYCLES if part == 1 else 1):
            for port in self.sources:
                port.offer(ctx, self.cycle, pauses, self.garbage, self.block.spacing_cycles)
            readies = [not pauses.stall(self.cycle, port.number) for port in self.sinks]
            for port, ready in zip(self.sinks, readies, strict=True):
                if port.is_stream:
                    ctx.set(port.ready, ready)
            seen = [port.ready for port in self.sources] + [v for port in self.sinks for v in (port.valid, port.word)]
            _, _, *values = await ctx.tick().sample(*seen)
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
            assert idle < self.row.idle_cycles, f"no more answers in clock {self.cycle}"

    def _count(self) -> int:
        return sum(len(port.cycles) for port in (*self.sources, *self.sinks))

    def _check_times(self) -> None:
        """Of all that was sent."""
        begins, answered = self.sources[0].begins, self.sinks[0].cycles
        latency_cycles = getattr(self.dut, "latency_cycles", None)
        if self.sinks[0].is_stream:
            assert self.row.remembers or latency_cycles is None or answered[0] - begins[0] == latency_cycles
        elif latency_cycles is not None:
            # Not every beat has an answer.
            assert {cycle - latency_cycles for cycle in answered} <= set(begins)
            assert len(answered) < len(begins) or answered[0] - begins[0] == latency_cycles
        if self.row.clocks_each:
            assert answered[-1] - answered[0] == self.row.clocks_each * (len(answered) - 1)


def check(row: Row) -> None:
    """Run a row in Amaranth's simulator.

    Raises
    ------
    AssertionError
        If an answer is wrong, missing or too many, comes at another time, or changes while it waits.
    """
    _simulator(_Bench(row)).run()


def record(row: Row, clocks: int) -> dict[str, list[int]]:
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
    bench = _Bench(row)
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
