"""Simulation by Amaranth's own simulator: a few thousand cycles per second, enough for tiny frames."""

from __future__ import annotations

import contextlib
import functools
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from amaranth.sim import Simulator

from sim.backends.interface import Progress, silent
from sim.simulators.design import Design, Ports
from sim.simulators.hardware import HardwareBackend
from sim.simulators.recording import (
    END_OF_LINE,
    NO_PAUSES,
    START_OF_FRAME,
    Output,
    Pauses,
    Recording,
    Segment,
    check_access,
)

RESET_CYCLES = 4
ACCESS_CYCLES = 64
HALF_CLOCK_S = 5e-9


def simulate(
    design: Design,
    segments: Sequence[Segment],
    *,
    pauses: Pauses = NO_PAUSES,
    waves: Path | None = None,
    progress: Progress = silent,
) -> list[Recording]:
    """Run segments one after the other, in Python; cycle for cycle the same as `sim.simulators.verilator.simulate`."""
    bench = _Bench(design.top(), design.ports, pauses)
    recordings: list[Recording] = []

    async def testbench(ctx: Any) -> None:
        await bench.reset(ctx)
        for segment in segments:
            progress(f"simulating {segment.data.size} pixels in Python")
            recordings.append(await bench.run(ctx, segment))

    simulator = Simulator(bench.top)
    simulator.add_testbench(testbench)
    with simulator.write_vcd(str(waves)) if waves else contextlib.nullcontext():
        simulator.run()
    return recordings


class _Bench:
    """The same as ``struct Bench`` of harness.cpp."""

    def __init__(self, top: Any, ports: Ports, pauses: Pauses):
        self.top = top
        self._ports = ports
        self._pauses = pauses
        self._cycle = 0

    async def reset(self, ctx: Any) -> None:
        self._rest(ctx)
        ctx.set(self.top.aresetn, 0)
        for _ in range(RESET_CYCLES):
            await self._settle(ctx)
            await self._edge(ctx)
        ctx.set(self.top.aresetn, 1)
        self._cycle = 0

    def _rest(self, ctx: Any) -> None:
        for prefix, member in ((self._ports.video, "tvalid"), *((prefix, "tready") for prefix in self._ports.outputs)):
            ctx.set(self._port(prefix, member), 0)

    async def run(self, ctx: Any, segment: Segment) -> Recording:
        self._ports.check(segment.settings)
        if segment.reset:
            await self.reset(ctx)
        for name, value in segment.settings.items():
            ctx.set(getattr(self.top, name), value)
        for address, value in segment.writes:
            await self._write(ctx, address, value)
        starts: list[int] = []
        traces = {prefix: _Trace() for prefix in (*self._ports.outputs, *self._ports.taps)}
        sent, offered = 0, False
        for _ in range(segment.cycle_limit):
            if sent == segment.data.size and all(
                len(traces[prefix].ends) >= segment.packets for prefix in self._ports.outputs
            ):
                self._rest(ctx)
                return _recording(self._ports, starts, traces)
            offered = offered or (sent < segment.data.size and not self._pauses.gap(self._cycle))
            if offered:
                self._offer(ctx, int(segment.data[sent]), int(segment.flags[sent]))
            ctx.set(self._port(self._ports.video, "tvalid"), offered)
            for index, prefix in enumerate(self._ports.outputs, start=1):
                ctx.set(self._port(prefix, "tready"), not self._pauses.stall(self._cycle, index))
            await self._settle(ctx)
            if offered and ctx.get(self._port(self._ports.video, "tready")):
                if segment.flags[sent] & START_OF_FRAME:
                    starts.append(self._cycle)
                sent, offered = sent + 1, False
            self._take(ctx, traces)
            await self._edge(ctx)
            self._cycle += 1
        raise segment.overdue(self._cycle)

    async def _write(self, ctx: Any, address: int, value: int) -> None:
        assert self._ports.control is not None, "the design has no registers"
        port = functools.partial(self._port, self._ports.control)
        for member, bits in (("awaddr", address), ("wdata", value), ("wstrb", 15), ("bready", 1)):
            ctx.set(port(member), bits)
        offered, response = {"aw": True, "w": True}, -1
        for _ in range(ACCESS_CYCLES):
            for channel, still in offered.items():
                ctx.set(port(f"{channel}valid"), still)
            await self._settle(ctx)
            offered = {channel: still and not ctx.get(port(f"{channel}ready")) for channel, still in offered.items()}
            if ctx.get(port("bvalid")):
                response = ctx.get(port("bresp"))
            await self._edge(ctx)
            self._cycle += 1
            if response >= 0:
                break
        ctx.set(port("bready"), 0)
        check_access("write", address, response)

    def _port(self, prefix: str, member: str) -> Any:
        return getattr(self.top, f"{prefix}_{member}")

    def _offer(self, ctx: Any, data: int, flags: int) -> None:
        ctx.set(self._port(self._ports.video, "tdata"), data)
        ctx.set(self._port(self._ports.video, "tuser"), bool(flags & START_OF_FRAME))
        ctx.set(self._port(self._ports.video, "tlast"), bool(flags & END_OF_LINE))

    def _take(self, ctx: Any, traces: dict[str, _Trace]) -> None:
        for prefix in self._ports.outputs:
            if ctx.get(self._port(prefix, "tready")) and ctx.get(self._port(prefix, "tvalid")):
                traces[prefix].words.append(ctx.get(self._port(prefix, "tdata")))
                if ctx.get(self._port(prefix, "tlast")):
                    traces[prefix].ends.append((len(traces[prefix].words), self._cycle))
        for prefix in self._ports.taps:
            if ctx.get(self._port(prefix, "tvalid")):
                traces[prefix].words.append(ctx.get(self._port(prefix, "tdata")))

    async def _settle(self, ctx: Any) -> None:
        ctx.set(self.top.aclk, 0)
        await ctx.delay(HALF_CLOCK_S)

    async def _edge(self, ctx: Any) -> None:
        ctx.set(self.top.aclk, 1)
        await ctx.delay(HALF_CLOCK_S)


@dataclass
class _Trace:
    words: list[int] = field(default_factory=list)
    ends: list[tuple[int, int]] = field(default_factory=list)


def _recording(ports: Ports, starts: list[int], traces: dict[str, _Trace]) -> Recording:
    words = {prefix: np.array(trace.words, np.uint64) for prefix, trace in traces.items()}
    ends = {prefix: np.array(trace.ends, np.uint64).reshape(-1, 2) for prefix, trace in traces.items()}
    return Recording(
        np.array(starts, np.uint64),
        {prefix: Output(words[prefix], ends[prefix]) for prefix in ports.outputs},
        {prefix: words[prefix] for prefix in ports.taps},
    )


def load(*, progress: Progress, waves: Path | None) -> HardwareBackend:
    """Make this backend for `sim.backends.interface.load_backend`."""
    return HardwareBackend(simulate, progress=progress, waves=waves)
