"""A memory behind AXI4 write ports, for Amaranth's simulator: it delays, refuses, and checks AXI's rules."""

import random
from collections import deque
from typing import Any

import numpy as np
from amaranth import Cat

from golden_model.records import WORD_BYTES
from hdl.axi.axi_lite import Response
from hdl.settings import PAGE_BYTES


class AxiMemory:
    """Memory from ``base`` on, which any number of ports write.

    Parameters
    ----------
    base, length_bytes : int
        Writes to any other address are faults of the design.
    waits : int
        0..255: probability per clock, in 1/256, that address or data are not accepted.
    latency_clocks : int
        Longest time from a burst's last word to its response.
    errors : int
        0..255: probability, in 1/256, that a burst is answered by SLVERR, without being written.
    data_first : bool
        Addresses are accepted only after a word of their burst, as AXI allows a memory to do.
    seed : int

    Attributes
    ----------
    bytes : uint8 ndarray
        Its contents.
    error_count : int
        Bursts answered by SLVERR.
    stuck : bool
        While it is set, nothing is accepted.
    """

    def __init__(
        self,
        base: int,
        length_bytes: int,
        *,
        waits: int = 0,
        latency_clocks: int = 2,
        errors: int = 0,
        data_first: bool = False,
        seed: int = 0,
    ) -> None:
        self.base = base
        self.bytes = np.zeros(length_bytes, np.uint8)
        self.waits, self.latency_clocks, self.errors = waits, latency_clocks, errors
        self.data_first = data_first
        self.error_count = 0
        self.stuck = False
        self._random = random.Random(seed)

    def port(self, bus: Any) -> Any:
        """A background testbench that serves ``bus``, an interface of `hdl.axi.axi_write.AXI_WRITE`.

        Raises
        ------
        AssertionError
            If the design withdraws or changes what it offers, crosses 4 KiB, ends a burst early or late, or leaves the
            memory.
        """

        async def testbench(ctx: Any) -> None:
            addresses: deque[tuple[int, int]] = deque()
            words: deque[tuple[int, int, int]] = deque()
            responses: deque[tuple[int, int]] = deque()
            offered: dict[str, Any] = {}
            clock = before = 0
            while True:
                ready = {channel: not self.stuck and self._random.randrange(256) >= self.waits for channel in "aw"}
                ready["a"] &= bool(words) or not self.data_first
                answers = bool(responses) and responses[0][0] <= clock
                driven = ready["a"] | ready["w"] << 1 | answers << 2 | (responses[0][1] if answers else 0) << 3
                # Each set lets the whole design settle: one for all, and only if something changes.
                if driven != before:
                    ctx.set(Cat(bus.awready, bus.wready, bus.bvalid, bus.bresp), driven)
                    before = driven
                address = (bus.awaddr, bus.awlen, bus.awsize, bus.awburst)
                word = (bus.wdata, bus.wstrb, bus.wlast)
                *_, awvalid, awaddr, awlen, awsize, awburst, wvalid, wdata, wstrb, wlast, bready = await ctx.tick(
                    "sync"
                ).sample(bus.awvalid, *address, bus.wvalid, *word, bus.bready)
                clock += 1
                _check_held(offered, "a", awvalid, ready["a"], (awaddr, awlen, awsize, awburst))
                _check_held(offered, "w", wvalid, ready["w"], (wdata, wstrb, wlast))
                if answers and bready:
                    responses.popleft()
                if awvalid and ready["a"]:
                    length = (awlen + 1) * WORD_BYTES
                    assert (awsize, awburst, awaddr % WORD_BYTES) == (3, 1, 0)
                    assert awaddr // PAGE_BYTES == (awaddr + length - 1) // PAGE_BYTES, "a burst crosses 4 KiB"
                    assert self.base <= awaddr <= self.base + self.bytes.size - length, f"{awaddr:#x} is outside"
                    addresses.append((awaddr - self.base, awlen + 1))
                if wvalid and ready["w"]:
                    words.append((wdata, wstrb, wlast))
                while addresses and len(words) >= addresses[0][1]:
                    offset, length = addresses.popleft()
                    burst = [words.popleft() for _ in range(length)]
                    assert [n for n, word in enumerate(burst, 1) if word[2]] == [length], "WLAST at the wrong word"
                    due = clock + self._random.randint(0, self.latency_clocks)
                    responses.append((due, self._write(offset, burst)))

        return testbench

    def _write(self, offset: int, words: list[tuple[int, int, int]]) -> int:
        """Store a burst; returns its response."""
        if self._random.randrange(256) < self.errors:
            self.error_count += 1
            return Response.SLVERR
        for number, (word, strobe, _) in enumerate(words):
            for byte in range(WORD_BYTES):
                if strobe >> byte & 1:
                    self.bytes[offset + number * WORD_BYTES + byte] = word >> 8 * byte & 0xFF
        return Response.OKAY


def _check_held(offered: dict[str, Any], channel: str, valid: int, ready: bool, payload: tuple[int, ...]) -> None:
    if channel in offered:
        assert valid, "withdrawn before it was taken"
        assert payload == offered[channel], "changed before it was taken"
    offered.pop(channel, None)
    if valid and not ready:
        offered[channel] = payload
