"""Frames of beats through a block in one call, in Amaranth's simulator."""

from __future__ import annotations

import random
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from amaranth.hdl import Shape, ShapeLike, Value
from amaranth.lib import data, wiring
from amaranth.sim import Simulator
from numpy.typing import NDArray

from hdl.blocks.vectors import pixel_beats
from sim.simulators.recording import NO_PAUSES, Pauses

CLOCK_S = 1e-8
DRAIN_CYCLES = 64
"""Clocks after the last beat."""


class Garbage:
    """Seeded random bits for the payload of a port that is not valid."""

    def __init__(self, seed: int):
        self._random = random.Random(seed)

    def put(self, ctx: Any, payload: Any) -> None:
        """Set ``payload`` to random bits."""
        bits = Value.cast(payload)
        ctx.set(bits, self._random.getrandbits(len(bits)))


@dataclass(frozen=True, eq=False)
class Beats:
    """Valid beats (`hdl.streams.beat`) in order."""

    cycles: NDArray[np.int64]
    """Clock of each beat, (N,)."""
    fields: dict[str, NDArray[Any]]
    """``x``, ``y`` and the fields of the payload, each of shape (N,) or, for arrays in the payload, (N, ...)."""

    def plane(self, field: str, shape: tuple[int, int], *, lag_px: int = 0) -> NDArray[Any]:
        """A field as a plane of ``shape``, each value at the pixel it belongs to; pixels without a beat are 0.

        That pixel lies ``lag_px`` to the left of the beat's position and above it.
        """
        values = self.fields[field]
        x, y = self.fields["x"] - lag_px, self.fields["y"] - lag_px
        inside = (x >= 0) & (y >= 0) & (x < shape[1]) & (y < shape[0])
        plane = np.zeros((*shape, *values.shape[1:]), values.dtype)
        plane[y[inside], x[inside]] = values[inside]
        return plane

    def split(self) -> list[Beats]:
        """The beats of each frame; a new frame starts where y decreases."""
        starts = np.flatnonzero(np.diff(self.fields["y"]) < 0) + 1
        parts = {name: np.split(values, starts) for name, values in self.fields.items()}
        return [
            Beats(cycles, {name: part[number] for name, part in parts.items()})
            for number, cycles in enumerate(np.split(self.cycles, starts))
        ]


def run_beats(
    dut: wiring.Component[Any],
    frames: Sequence[Mapping[str, NDArray[np.integer]]],
    *,
    settings: Mapping[str, Any] | None = None,
    pauses: Pauses = NO_PAUSES,
    received_per_clock: int | None = None,
) -> tuple[Beats, Beats]:
    """Send frames as beats to the port ``i`` of a component and record those at its port ``o``.

    Parameters
    ----------
    dut : Component
        In the domain ``sync``, with beats at ``i`` and ``o``, of ``pixels_per_clock`` pixels if it has that attribute.
    frames : sequence of mapping of str to ndarray
        For each frame, the planes of the payload's fields: shape (H, W) or, for arrays, (H, W, ...). They are sent in
        raster order without a pause between frames other than the seeded gaps, which hold garbage.
    settings : mapping of str to values, optional
        Other input ports, set once.
    pauses : Pauses
        Gaps of the input.
    received_per_clock : int, optional
        Pixels of a beat at ``o``, if their number differs from that at ``i``.

    Returns
    -------
    sent, received : Beats
        One for each pixel, including the pixel that fills the last beat of an odd line. ``received.cycles -
        sent.cycles`` is the latency of a block that sends one beat for each beat.
    """
    i, o = (getattr(dut, name) for name in ("i", "o"))
    layout = i.shape()
    count = getattr(dut, "pixels_per_clock", 1)
    pack = _make_packer(layout)
    beats = [pack({"valid": 1, **beat}) for frame in frames for beat in pixel_beats(frame, count)]
    sent: list[tuple[int, int]] = []
    received: list[tuple[int, int]] = []

    async def testbench(ctx: Any) -> None:
        for name, value in (settings or {}).items():
            ctx.set(getattr(dut, name), value)
        garbage = Garbage(pauses.seed)
        waiting = iter(beats)
        left, cycle = len(beats), 0
        while left or cycle <= sent[-1][0] + DRAIN_CYCLES:
            garbage.put(ctx, i)
            ctx.set(i.valid, 0)
            if left and not pauses.gap(cycle):
                sent.append((cycle, next(waiting)))
                ctx.set(Value.cast(i), sent[-1][1])
                left -= 1
            *_, valid, bits = await ctx.tick().sample(o.valid, Value.cast(o))
            if valid:
                received.append((cycle, bits))
            cycle += 1

    simulator = Simulator(dut)
    simulator.add_clock(CLOCK_S)
    simulator.add_testbench(testbench)
    simulator.run()
    return _decode(sent, layout, count), _decode(received, o.shape(), received_per_clock or count)


def _decode(beats: Sequence[tuple[int, int]], layout: data.Layout, pixels_per_clock: int) -> Beats:
    fields = {
        str(name): np.array([unpack(bits >> field.offset) for _, bits in beats])
        for name, field in layout
        if name != "valid"
        for unpack in (_make_unpacker(field.shape),)
    }
    cycles = np.array([cycle for cycle, _ in beats])
    if pixels_per_clock > 1:
        scan = {name: np.repeat(fields.pop(name), pixels_per_clock) for name in "xy"}
        scan["x"] += np.tile(np.arange(pixels_per_clock), len(beats))
        fields = {**scan, **{name: values.reshape(-1, *values.shape[2:]) for name, values in fields.items()}}
        cycles = np.repeat(cycles, pixels_per_clock)
    return Beats(cycles, fields)


def _make_packer(shape: ShapeLike) -> Callable[[Any], int]:
    """A function that turns values of a shape into bits: ``Layout.const`` would take a quarter of a test's time."""
    if isinstance(shape, data.Layout):
        fields = [(name, field.offset, _make_packer(field.shape)) for name, field in shape]
        return lambda value: sum(pack(value[name]) << offset for name, offset, pack in fields)
    mask = (1 << Shape.cast(shape).width) - 1
    return lambda value: int(value) & mask


def _make_unpacker(shape: ShapeLike) -> Callable[[int], Any]:
    """A function that turns the low bits of a number into an integer, or into lists where the shape is an array."""
    if isinstance(shape, data.ArrayLayout):
        elements = [(field.offset, _make_unpacker(field.shape)) for _, field in shape]
        return lambda bits: [unpack(bits >> offset) for offset, unpack in elements]
    plain = Shape.cast(shape)
    mask, sign = (1 << plain.width) - 1, (1 << plain.width >> 1) if plain.signed else 0
    return lambda bits: ((bits & mask) ^ sign) - sign
