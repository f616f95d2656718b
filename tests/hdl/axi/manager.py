"""A manager on AXI4-Lite: one access after the other."""

from collections.abc import Sequence
from typing import Any

from amaranth.lib.wiring import FlippedInterface

CYCLE_LIMIT = 200


async def write(ctx: Any, bus: FlippedInterface, address: int, data: int, *, strobe: int = 15) -> int:
    """Write a register; returns the response."""
    for name, value in (("awaddr", address), ("wdata", data), ("wstrb", strobe)):
        ctx.set(getattr(bus, name), value)
    return (await _access(ctx, bus, ("aw", "w"), "b", ("bresp",)))[0]


async def read(ctx: Any, bus: FlippedInterface, address: int) -> list[int]:
    """Read a register; returns its data and the response."""
    ctx.set(bus.araddr, address)
    return await _access(ctx, bus, ("ar",), "r", ("rdata", "rresp"))


async def _access(
    ctx: Any, bus: FlippedInterface, asks: Sequence[str], answers: str, fields: Sequence[str]
) -> list[int]:
    waiting = set(asks)
    for channel in asks:
        ctx.set(getattr(bus, f"{channel}valid"), 1)
    ctx.set(getattr(bus, f"{answers}ready"), 1)
    for _ in range(CYCLE_LIMIT):
        taken = {channel for channel in waiting if ctx.get(getattr(bus, f"{channel}ready"))}
        valid, *answer = (ctx.get(getattr(bus, name)) for name in (f"{answers}valid", *fields))
        await ctx.tick()
        for channel in taken:
            ctx.set(getattr(bus, f"{channel}valid"), 0)
        waiting -= taken
        if valid:
            ctx.set(getattr(bus, f"{answers}ready"), 0)
            return answer
    raise AssertionError(f"no answer within {CYCLE_LIMIT} clocks")
