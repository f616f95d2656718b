"""Sources and sinks for block tests in Amaranth's simulator, with seeded gaps and stalls."""

from __future__ import annotations

import random
from collections.abc import Callable, Coroutine, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from amaranth.hdl import Shape, ShapeLike, Value
from amaranth.lib import data, stream, wiring
from amaranth.sim import Simulator
from numpy.typing import NDArray

from sim.recording import NO_PAUSES, Pauses

CLOCK_S = 1e-8

Testbench = Callable[[Any], Coroutine[Any, Any, None]]


def run_streams(
    dut: wiring.Component,
    inputs: Mapping[str, Sequence[Any]],
    counts: Mapping[str, int],
    *,
    settings: Mapping[str, Any] | None = None,
    pauses: Pauses = NO_PAUSES,
    cycle_limit: int = 10_000,
) -> dict[str, list[Any]]:
    """Stream payloads through a component and return what leaves it.

    Parameters
    ----------
    dut : Component
        In the domain ``sync``.
    inputs : mapping of str to sequence
        For each input port, the payloads to send.
    counts : mapping of str to int
        For each output port, how many payloads to wait for.
    settings : mapping of str to values, optional
        Other input ports, set once.
    pauses : Pauses
        Gaps of the inputs, stalls of the outputs.
    cycle_limit : int

    Returns
    -------
    dict of str to list
        The payloads of each output port, in order.

    Raises
    ------
    AssertionError
        If an output breaks the stream rules (a payload changes or vanishes before it is taken), or the counts are
        not reached within the limit.
    """
    received: dict[str, list[Any]] = {name: [] for name in counts}
    simulator = Simulator(dut)
    simulator.add_clock(CLOCK_S)
    simulator.add_testbench(_setting(dut, settings or {}))
    for number, (name, payloads) in enumerate(inputs.items()):
        simulator.add_testbench(_source(getattr(dut, name), payloads, pauses, number))
    for number, (name, count) in enumerate(counts.items(), start=len(inputs)):
        simulator.add_testbench(_sink(getattr(dut, name), count, received[name], pauses, number))
    simulator.add_testbench(_limit(cycle_limit, received), background=True)
    simulator.run()
    return received


@dataclass(frozen=True, eq=False)
class Beats:
    """Valid beats (`hdl.streams.beat`) in order.

    Parameters
    ----------
    cycles : int64 ndarray, shape (N,)
        Clock of each beat.
    fields : dict of str to ndarray
        ``x``, ``y`` and the payload, each of shape (N,) or, for arrays in the payload, (N, ...).
    """

    cycles: NDArray[np.int64]
    fields: dict[str, NDArray[Any]]

    def plane(self, field: str, shape: tuple[int, int], *, lag_px: int = 0) -> NDArray[Any]:
        """A field as a plane of ``shape``, each value at the pixel that it describes; pixels without a beat are 0."""
        values = self.fields[field]
        x, y = self.fields["x"] - lag_px, self.fields["y"] - lag_px
        inside = (x >= 0) & (y >= 0) & (x < shape[1]) & (y < shape[0])
        plane = np.zeros((*shape, *values.shape[1:]), values.dtype)
        plane[y[inside], x[inside]] = values[inside]
        return plane

    def split(self) -> list[Beats]:
        """The beats of each frame: one starts where y falls."""
        starts = np.flatnonzero(np.diff(self.fields["y"]) < 0) + 1
        parts = {name: np.split(values, starts) for name, values in self.fields.items()}
        return [
            Beats(cycles, {name: part[number] for name, part in parts.items()})
            for number, cycles in enumerate(np.split(self.cycles, starts))
        ]


def run_beats(
    dut: wiring.Component,
    frames: Sequence[Mapping[str, NDArray[np.integer]]],
    *,
    settings: Mapping[str, Any] | None = None,
    pauses: Pauses = NO_PAUSES,
    drain_cycles: int = 64,
) -> tuple[Beats, Beats]:
    """Send frames as beats to the port ``i`` of a component and record those at its port ``o``.

    Parameters
    ----------
    dut : Component
        In the domain ``sync``, with beats at ``i`` and ``o``.
    frames : sequence of mapping of str to ndarray
        For each frame, the planes of the payload's fields: shape (H, W) or, for arrays, (H, W, ...). They are sent in
        raster order without a pause between frames other than the seeded gaps, which hold garbage.
    settings : mapping of str to values, optional
        Other input ports, set once.
    pauses : Pauses
        Gaps of the input.
    drain_cycles : int
        Clocks after the last beat.

    Returns
    -------
    sent, received : Beats
        ``received.cycles - sent.cycles`` is the latency of a block that answers each beat.
    """
    layout = dut.i.shape()
    beats = [layout.const(beat).as_bits() for frame in frames for beat in _raster(frame)]
    sent: list[tuple[int, int]] = []
    received: list[tuple[int, int]] = []

    async def testbench(ctx: Any) -> None:
        garbage = Garbage(pauses.seed)
        waiting = iter(beats)
        left, cycle = len(beats), 0
        for name, value in (settings or {}).items():
            ctx.set(getattr(dut, name), value)
        while left or cycle <= sent[-1][0] + drain_cycles:
            garbage.put(ctx, dut.i)
            ctx.set(dut.i.valid, 0)
            if left and not pauses.gap(cycle):
                sent.append((cycle, next(waiting)))
                ctx.set(Value.cast(dut.i), sent[-1][1])
                left -= 1
            *_, valid, bits = await ctx.tick().sample(dut.o.valid, Value.cast(dut.o))
            if valid:
                received.append((cycle, bits))
            cycle += 1

    simulator = Simulator(dut)
    simulator.add_clock(CLOCK_S)
    simulator.add_testbench(testbench)
    simulator.run()
    return _decoded(sent, layout), _decoded(received, dut.o.shape())


def _raster(frame: Mapping[str, NDArray[np.integer]]) -> Iterator[dict[str, Any]]:
    height, width = next(iter(frame.values())).shape[:2]
    for y, x in np.ndindex(height, width):
        yield {"valid": 1, "x": x, "y": y, **{name: plane[y, x].tolist() for name, plane in frame.items()}}


def _decoded(beats: Sequence[tuple[int, int]], layout: data.Layout) -> Beats:
    fields = {
        name: np.array([_plain(bits >> field.offset, field.shape) for _, bits in beats])
        for name, field in layout
        if name != "valid"
    }
    return Beats(np.array([cycle for cycle, _ in beats]), fields)


def _plain(bits: int, shape: ShapeLike) -> Any:
    """The low bits of ``bits`` as an integer, or as lists where ``shape`` is an array."""
    if isinstance(shape, data.ArrayLayout):
        return [_plain(bits >> field.offset, field.shape) for _, field in shape]
    plain = Shape.cast(shape)
    value = bits & ((1 << plain.width) - 1)
    return value - (1 << plain.width) if plain.signed and value >> (plain.width - 1) else value


def _setting(dut: wiring.Component, settings: Mapping[str, Any]) -> Testbench:
    async def testbench(ctx: Any) -> None:
        for name, value in settings.items():
            ctx.set(getattr(dut, name), value)

    return testbench


def _source(port: stream.Interface, payloads: Sequence[Any], pauses: Pauses, number: int) -> Testbench:
    async def testbench(ctx: Any) -> None:
        garbage = Garbage(pauses.seed)
        cycle = 0
        for payload in payloads:
            while pauses.gap(cycle, number):
                garbage.put(ctx, port.payload)
                await ctx.tick()
                cycle += 1
            ctx.set(port.payload, payload)
            ctx.set(port.valid, 1)
            taken = False
            while not taken:
                *_, taken = await ctx.tick().sample(port.ready)
                cycle += 1
            ctx.set(port.valid, 0)
        garbage.put(ctx, port.payload)

    return testbench


def _sink(port: stream.Interface, count: int, received: list[Any], pauses: Pauses, number: int) -> Testbench:
    async def testbench(ctx: Any) -> None:
        cycle, waiting = 0, None
        while len(received) < count:
            ready = not pauses.stall(cycle, number)
            ctx.set(port.ready, ready)
            *_, valid, payload, raw = await ctx.tick().sample(port.valid, port.payload, Value.cast(port.payload))
            cycle += 1
            if waiting is not None and not (valid and raw == waiting):
                raise AssertionError(f"a payload was withdrawn before it was taken, cycle {cycle}")
            waiting = raw if valid and not ready else None
            if valid and ready:
                received.append(payload)
        ctx.set(port.ready, 0)

    return testbench


def _limit(cycle_limit: int, received: Mapping[str, Sequence[Any]]) -> Testbench:
    async def testbench(ctx: Any) -> None:
        for _ in range(cycle_limit):
            await ctx.tick()
        counts = {name: len(payloads) for name, payloads in received.items()}
        raise AssertionError(f"not done within {cycle_limit} cycles; received: {counts}")

    return testbench


class Garbage:
    """Seeded random bits for whatever a port says while it is not valid."""

    def __init__(self, seed: int):
        self._random = random.Random(seed)

    def put(self, ctx: Any, payload: Any) -> None:
        """Set ``payload`` to random bits."""
        bits = Value.cast(payload)
        ctx.set(bits, self._random.getrandbits(len(bits)))
