"""Simulation by Amaranth's own simulator: a few hundred clocks per second, enough for tiny frames."""

from __future__ import annotations

import contextlib
import functools
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from amaranth.sim import Simulator
from numpy.typing import NDArray

from sim.backends.interface import Progress, silent
from sim.simulators.design import Design, Ports
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
    """Run segments one after the other, in Python; clock for clock the same as `sim.simulators.verilator.simulate`."""
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

    def _port(self, prefix: str, member: str) -> Any:
        return getattr(self.top, f"{prefix}_{member}")

    async def reset(self, ctx: Any) -> None:
        self._stop_streams(ctx)
        ctx.set(self.top.aresetn, 0)
        for _ in range(RESET_CYCLES):
            await self._settle(ctx)
            await self._edge(ctx)
        ctx.set(self.top.aresetn, 1)
        self._cycle = 0

    def _stop_streams(self, ctx: Any) -> None:
        ctx.set(self._port(self._ports.video, "tvalid"), 0)
        for prefix in self._ports.outputs:
            ctx.set(self._port(prefix, "tready"), 0)

    async def run(self, ctx: Any, segment: Segment) -> Recording:
        self._ports.check(segment.settings)
        if segment.reset:
            await self.reset(ctx)
        for name, value in segment.settings.items():
            ctx.set(getattr(self.top, name), value)
        for address, value in segment.writes:
            await self._write(ctx, address, value)
        starts: list[int] = []
        words: dict[str, list[int]] = {prefix: [] for prefix in (*self._ports.outputs, *self._ports.taps)}
        ends: dict[str, list[tuple[int, int]]] = {prefix: [] for prefix in self._ports.outputs}
        video = functools.partial(self._port, self._ports.video)
        sent, offered = 0, False
        for _ in range(segment.cycle_limit):
            if sent == segment.data.size and all(len(packets) >= segment.packets for packets in ends.values()):
                self._stop_streams(ctx)
                outputs = {
                    prefix: Output(_words(words.pop(prefix)), _words(ends[prefix]).reshape(-1, 2)) for prefix in ends
                }
                return Recording(_words(starts), outputs, {prefix: _words(values) for prefix, values in words.items()})
            offered = offered or (sent < segment.data.size and not self._pauses.gap(self._cycle))
            if offered:
                ctx.set(video("tdata"), int(segment.data[sent]))
                ctx.set(video("tuser"), bool(segment.flags[sent] & START_OF_FRAME))
                ctx.set(video("tlast"), bool(segment.flags[sent] & END_OF_LINE))
            ctx.set(video("tvalid"), offered)
            for index, prefix in enumerate(self._ports.outputs, start=1):
                ctx.set(self._port(prefix, "tready"), not self._pauses.stall(self._cycle, index))
            await self._settle(ctx)
            if offered and ctx.get(video("tready")):
                if segment.flags[sent] & START_OF_FRAME:
                    starts.append(self._cycle)
                sent, offered = sent + 1, False
            self._record(ctx, words, ends)
            await self._edge(ctx)
            self._cycle += 1
        raise segment.timeout_error(self._cycle)

    def _record(self, ctx: Any, words: dict[str, list[int]], ends: dict[str, list[tuple[int, int]]]) -> None:
        for prefix, values in words.items():
            is_tap = prefix not in ends
            if ctx.get(self._port(prefix, "tvalid")) and (is_tap or ctx.get(self._port(prefix, "tready"))):
                values.append(ctx.get(self._port(prefix, "tdata")))
                if not is_tap and ctx.get(self._port(prefix, "tlast")):
                    ends[prefix].append((len(values), self._cycle))

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

    # The domain of a top is driven by its port `aclk`, so the simulator's own clocks cannot drive it.
    async def _settle(self, ctx: Any) -> None:
        ctx.set(self.top.aclk, 0)
        await ctx.delay(HALF_CLOCK_S)

    async def _edge(self, ctx: Any) -> None:
        ctx.set(self.top.aclk, 1)
        await ctx.delay(HALF_CLOCK_S)


def _words(values: Sequence[Any]) -> NDArray[np.uint64]:
    return np.array(values, np.uint64)
