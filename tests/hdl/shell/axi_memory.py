"""A memory behind AXI4 ports, for Amaranth's simulator: it delays, refuses, and checks AXI's rules."""

import random
from collections import deque
from typing import Any

import numpy as np
from amaranth import Cat

from golden_model.records import WORD_BYTES
from hdl.axi.axi_lite import Response
from hdl.axi.axi_read import MAX_OPEN_BURSTS
from hdl.settings import PAGE_BYTES


class AxiMemory:
    """Memory from ``base`` on, which any number of ports write and read.

    Parameters
    ----------
    base, length_bytes : int
        Any other address is a fault of the design.
    waits : int
        0..255: probability per clock, in 1/256, that address or data are not accepted, or that no word is given.
    latency_clocks : int
        Longest time from a burst's last word to its response, or from its address to its first word.
    errors : int
        0..255: probability, in 1/256, that a burst is answered by SLVERR, without being written or read.
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
        While it is set, nothing is accepted or given.
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
            driven_ports = Cat(bus.awready, bus.wready, bus.bvalid, bus.bresp)
            clock = before = 0

            def drive() -> tuple[dict[str, bool], bool]:
                """Drive the ports for the next clock; what is ready, and whether a response is given."""
                nonlocal before
                ready = {channel: not self.stuck and self._random.randrange(256) >= self.waits for channel in "aw"}
                ready["a"] &= bool(words) or not self.data_first
                answers = bool(responses) and responses[0][0] <= clock
                driven = ready["a"] | ready["w"] << 1 | answers << 2 | (responses[0][1] if answers else 0) << 3
                # Each set lets the whole design settle: one for all, and only if something changes.
                if driven != before:
                    ctx.set(driven_ports, driven)
                    before = driven
                return ready, answers

            address = (bus.awaddr, bus.awlen, bus.awsize, bus.awburst)
            word = (bus.wdata, bus.wstrb, bus.wlast)
            ready, answers = drive()
            async for *_, awvalid, awaddr, awlen, awsize, awburst, wvalid, wdata, wstrb, wlast, bready in ctx.tick(
                "sync"
            ).sample(bus.awvalid, *address, bus.wvalid, *word, bus.bready):
                clock += 1
                _check_held(offered, "a", awvalid, ready["a"], (awaddr, awlen, awsize, awburst))
                _check_held(offered, "w", wvalid, ready["w"], (wdata, wstrb, wlast))
                if answers and bready:
                    responses.popleft()
                if awvalid and ready["a"]:
                    addresses.append((self._offset(awaddr, awlen, awsize, awburst), awlen + 1))
                if wvalid and ready["w"]:
                    words.append((wdata, wstrb, wlast))
                while addresses and len(words) >= addresses[0][1]:
                    offset, length = addresses.popleft()
                    burst = [words.popleft() for _ in range(length)]
                    assert [n for n, word in enumerate(burst, 1) if word[2]] == [length], "WLAST at the wrong word"
                    due = clock + self._random.randint(0, self.latency_clocks)
                    responses.append((due, self._write(offset, burst)))
                ready, answers = drive()

        return testbench

    def read_port(self, bus: Any) -> Any:
        """A background testbench that serves ``bus``, an interface of `hdl.axi.axi_read.AXI_READ`.

        Raises
        ------
        AssertionError
            As by `port`, or if more than `MAX_OPEN_BURSTS` are open.
        """

        async def testbench(ctx: Any) -> None:
            # Of each word: from when on it can be given, the word, its response, and whether it is its burst's last.
            words: deque[tuple[int, int, int, bool]] = deque()
            offered: dict[str, Any] = {}
            driven_ports = Cat(bus.arready, bus.rvalid, bus.rlast, bus.rresp, bus.rdata)
            clock = before = 0
            given = False

            def drive() -> bool:
                """Drive the ports for the next clock; whether an address is accepted."""
                nonlocal before, given
                accepts = not self.stuck and self._random.randrange(256) >= self.waits
                # A word that is offered stays until it is taken.
                waits = self.stuck or self._random.randrange(256) < self.waits
                given = bool(words) and (given or (words[0][0] <= clock and not waits))
                _, word, response, last = words[0] if given else (0, self._random.getrandbits(64), 0, False)
                driven = accepts | given << 1 | last << 2 | response << 3 | word << 5
                if driven != before:
                    ctx.set(driven_ports, driven)
                    before = driven
                return accepts

            accepts = drive()
            async for *_, arvalid, araddr, arlen, arsize, arburst, rready in ctx.tick("sync").sample(
                bus.arvalid, bus.araddr, bus.arlen, bus.arsize, bus.arburst, bus.rready
            ):
                clock += 1
                _check_held(offered, "a", arvalid, accepts, (araddr, arlen, arsize, arburst))
                if given and rready:
                    words.popleft()
                    given = False
                if arvalid and accepts:
                    burst = self._read(self._offset(araddr, arlen, arsize, arburst), arlen + 1)
                    due = clock + self._random.randint(0, self.latency_clocks)
                    words.extend((due, *each, n == arlen) for n, each in enumerate(burst))
                    assert sum(last for *_, last in words) <= MAX_OPEN_BURSTS, "too many bursts are open"
                accepts = drive()

        return testbench

    def _offset(self, address: int, length: int, size: int, burst: int) -> int:
        """Where a burst starts in the memory; its rules are checked."""
        length_bytes = (length + 1) * WORD_BYTES
        assert (size, burst, address % WORD_BYTES) == (3, 1, 0)
        assert address // PAGE_BYTES == (address + length_bytes - 1) // PAGE_BYTES, "a burst crosses 4 KiB"
        assert self.base <= address <= self.base + self.bytes.size - length_bytes, f"{address:#x} is outside"
        return address - self.base

    def _read(self, offset: int, length: int) -> list[tuple[int, int]]:
        """The words of a burst, each with its response; random ones where they fail."""
        if self._random.randrange(256) < self.errors:
            self.error_count += 1
            return [(self._random.getrandbits(64), Response.SLVERR) for _ in range(length)]
        words = self.bytes[offset : offset + length * WORD_BYTES].view("<u8").tolist()
        return [(word, Response.OKAY) for word in words]

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
