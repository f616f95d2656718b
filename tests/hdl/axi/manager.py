"""A manager on AXI4-Lite: one access, channel by channel."""

import random
from typing import Any

from amaranth.lib.wiring import FlippedInterface

CYCLE_LIMIT = 200


async def write(
    ctx: Any, bus: FlippedInterface, address: int, data: int, *, strobe: int = 15, rng: random.Random | None = None
) -> int:
    """Write a register; ``rng`` chooses the order of address and data and delays the response."""
    waits = [rng.randrange(4) for _ in range(3)] if rng else [0, 0, 0]
    ctx.set(bus.awaddr, address)
    ctx.set(bus.wdata, data)
    ctx.set(bus.wstrb, strobe)
    pending = {"aw": waits[0], "w": waits[1]}
    for _ in range(CYCLE_LIMIT):
        for channel, wait in pending.items():
            ctx.set(getattr(bus, f"{channel}valid"), wait <= 0)
        accepted = [c for c, wait in pending.items() if wait <= 0 and ctx.get(getattr(bus, f"{c}ready"))]
        pending = {c: wait - 1 for c, wait in pending.items() if c not in accepted}
        await ctx.tick()
        for channel in accepted:
            ctx.set(getattr(bus, f"{channel}valid"), 0)
        if not pending:
            break
    for _ in range(waits[2]):
        await ctx.tick()
    return await _response(ctx, bus, "b", "bresp")


async def _response(ctx: Any, bus: FlippedInterface, channel: str, field: str) -> int:
    ctx.set(getattr(bus, f"{channel}ready"), 1)
    for _ in range(CYCLE_LIMIT):
        valid, value = ctx.get(getattr(bus, f"{channel}valid")), ctx.get(getattr(bus, field))
        await ctx.tick()
        if valid:
            ctx.set(getattr(bus, f"{channel}ready"), 0)
            return value
    raise AssertionError(f"no {field} within {CYCLE_LIMIT} clocks")


async def read(ctx: Any, bus: FlippedInterface, address: int) -> tuple[int, int]:
    ctx.set(bus.araddr, address)
    ctx.set(bus.arvalid, 1)
    for _ in range(CYCLE_LIMIT):
        ready = ctx.get(bus.arready)
        await ctx.tick()
        if ready:
            break
    ctx.set(bus.arvalid, 0)
    ctx.set(bus.rready, 1)
    for _ in range(CYCLE_LIMIT):
        valid, data, resp = ctx.get(bus.rvalid), ctx.get(bus.rdata), ctx.get(bus.rresp)
        await ctx.tick()
        if valid:
            ctx.set(bus.rready, 0)
            return data, resp
    raise AssertionError(f"no rdata within {CYCLE_LIMIT} clocks")
