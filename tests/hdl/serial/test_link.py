# amaranth: UnusedElaboratable=no
"""The serial port with its commands, at the pins: bits in, bits out, a stub of the accelerator between."""

from collections import deque
from collections.abc import Sequence
from typing import Any

import pytest
from amaranth import Module, Mux, Signal
from amaranth.lib import fifo, wiring
from amaranth.lib.wiring import In, Out
from amaranth.sim import Simulator

from golden_model.records import WORD_BYTES
from hdl.axi.axi_lite import AxiLiteSubordinate
from hdl.serial import link
from hdl.serial.link import Command, Message, SerialLink
from hdl.serial.uart import UartReceiver, UartTransmitter
from tests.hdl.block_bench import BlockBench

CLOCKS_PER_BIT = 4
BYTE_CLOCKS = 10 * CLOCKS_PER_BIT


class Board(wiring.Component):
    """The link between the pins, with one register at address 8."""

    def __init__(self) -> None:
        self.link = SerialLink(("features", "matches", "homographies"))
        super().__init__({"i_pin": In(1, init=1), "o_pin": Out(1)})  # type: ignore[call-arg] # not in the stubs

    def elaborate(self, platform: object) -> Module:
        m = Module()
        m.submodules.link = inner = self.link
        m.submodules.receiver = receiver = UartReceiver(clocks_per_bit=CLOCKS_PER_BIT)
        m.submodules.transmitter = transmitter = UartTransmitter(clocks_per_bit=CLOCKS_PER_BIT)
        m.submodules.registers = registers = AxiLiteSubordinate()
        register = Signal(32)
        m.submodules.waiting = waiting = fifo.SyncFIFOBuffered(width=8, depth=64)
        wiring.connect(m, inner.control, registers.bus)
        wiring.connect(m, inner.o, transmitter.i)
        m.d.comb += [
            receiver.i_pin.eq(self.i_pin),
            self.o_pin.eq(transmitter.o_pin),
            waiting.w_en.eq(receiver.o_valid),
            waiting.w_data.eq(receiver.o_byte),
            inner.i.valid.eq(waiting.r_rdy),
            inner.i.payload.eq(waiting.r_data),
            waiting.r_en.eq(inner.i.ready),
            inner.i_lost.eq(receiver.o_broken),
            registers.i_data.eq(Mux(registers.o_read_word == 2, register, 0)),
        ]
        with m.If(registers.o_write & (registers.o_write_word == 2)):
            m.d.sync += register.eq(registers.o_data)
        return m


def talk(
    sent: list[int],
    *,
    features: Sequence[dict[str, int]] = (),
    matches: Sequence[dict[str, int]] = (),
    homographies: Sequence[dict[str, int]] = (),
    answers: int = 0,
    stop_bits: bool = True,
) -> tuple[Any, ...]:
    """Send bytes as bits; returns the bytes that came back as bits, and the pixels that the accelerator got.

    A number below 0 is a pause of so many clocks.
    """
    board = Board()
    received: list[Any] = []
    pixels: list[Any] = []
    wanted = answers + (1 + WORD_BYTES) * (len(features) + len(matches) + len(homographies))
    simulator = Simulator(board)
    simulator.add_clock(1e-6)

    async def send(ctx: Any) -> None:
        for number, byte in enumerate(sent):
            if byte < 0:
                await ctx.tick().repeat(-byte)
                continue
            for bit in (0, *(byte >> n & 1 for n in range(8)), int(stop_bits or number > 0)):
                ctx.set(board.i_pin, bit)
                await ctx.tick().repeat(CLOCKS_PER_BIT)
            ctx.set(board.i_pin, 1)
            if not stop_bits:
                await ctx.tick().repeat(CLOCKS_PER_BIT)
        await ctx.tick().repeat(BYTE_CLOCKS)

    async def receive(ctx: Any) -> None:
        while len(received) < wanted:
            while ctx.get(board.o_pin):
                await ctx.tick()
            await ctx.tick().repeat(CLOCKS_PER_BIT // 2)
            byte = 0
            for n in range(8):
                await ctx.tick().repeat(CLOCKS_PER_BIT)
                byte |= ctx.get(board.o_pin) << n
            await ctx.tick().repeat(CLOCKS_PER_BIT)
            assert ctx.get(board.o_pin), "no stop bit"
            received.append(byte)

    def offer(port: Any, words: Any) -> Any:
        async def testbench(ctx: Any) -> None:
            waiting = deque(words)
            while waiting:
                ctx.set(port.payload, waiting[0])
                ctx.set(port.valid, 1)
                *_, ready = await ctx.tick().sample(port.ready)
                if ready:
                    waiting.popleft()
            ctx.set(port.valid, 0)

        return testbench

    async def take(ctx: Any) -> None:
        ctx.set(board.link.o_video.ready, 1)
        while True:
            *_, valid, beat = await ctx.tick().sample(board.link.o_video.valid, board.link.o_video.payload)
            if valid:
                pixels.append((beat.data, beat.last))

    for testbench in (send, receive):
        simulator.add_testbench(testbench)
    for output, words in (("features", features), ("matches", matches), ("homographies", homographies)):
        simulator.add_testbench(offer(getattr(board.link, f"i_{output}"), words))
    simulator.add_testbench(take, background=True)
    simulator.run_until(1e-6 * (2 * BYTE_CLOCKS * (len(sent) + wanted + 4) - sum(each for each in sent if each < 0)))
    return received, pixels


def command(kind: Command, field: int, *more: int) -> list[int]:
    return [kind, field & 0xFF, field >> 8, *more]


def answer(data: int, status: int = 0) -> list[int]:
    return [Message.ANSWER, status, *data.to_bytes(4, "little")]


def test_registers_are_written_and_read() -> None:
    written = command(Command.WRITE, 8, 0x78, 0x56, 0x34, 0x12)
    sent = [0xFF, *written, *command(Command.READ, 8), *command(Command.READ, 12)]
    received, _ = talk(sent, answers=18)
    # The first byte is no command; no register is at 12.
    assert received == answer(0) + answer(0x12345678) + answer(0)


def test_a_command_that_breaks_off_is_forgotten_and_one_that_pauses_is_not(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(link, "FORGET_CLOCKS", 256)
    write = command(Command.WRITE, 8, 0x78, 0x56, 0x34, 0x12)
    pauses = [*write[:2], -200, *write[2:5], -200, *write[5:]]
    broken = [write[:2], write[:5], command(Command.PIXELS, 9, 1, 2)]
    sent = [*pauses, *(part for bytes_ in broken for part in (*bytes_, -350, *command(Command.READ, 8)))]
    received, pixels = talk(sent, answers=24)
    assert received == answer(0) + 3 * answer(0x12345678)
    assert pixels == [(1, 0), (2, 0)]


def test_words_of_all_packets_are_told_apart_and_an_answer_overtakes_them() -> None:
    features = [{"data": 0x0807060504030201, "last": 0}, {"data": 1, "last": 1}]
    matches, homographies = [{"data": 2, "last": 1}], [{"data": 3, "last": 1}]
    sent = command(Command.READ, 8)
    received, _ = talk(sent, features=features, matches=matches, homographies=homographies, answers=6)
    words = [Message.FEATURES, *range(1, 9), Message.FEATURES | Message.LAST, 1, *[0] * 7]
    last = [Message.MATCHES | Message.LAST, 2, *[0] * 7, Message.HOMOGRAPHIES | Message.LAST, 3, *[0] * 7]
    assert sorted(received) == sorted([*words, *last, *answer(0)])
    # The answer comes between two words: after the first, second or third.
    position = next(n for n in (9, 18, 27) if received[n : n + 6] == answer(0))
    assert received[:position] + received[position + 6 :] == [*words, *last]


def test_a_byte_without_stop_bit_is_dropped_and_reported_once() -> None:
    received, _ = talk([0, *command(Command.READ, 8), *command(Command.READ, 8)], answers=12, stop_bits=False)
    assert received == answer(0, status=0x80) + answer(0)


def test_a_byte_lost_as_an_answer_leaves_is_told_by_the_next_one() -> None:
    dut = SerialLink()
    bench = BlockBench(dut, cycle_limit=200)
    found: list[int] = []

    async def run(ctx: Any) -> None:
        ctx.set(dut.control.rvalid, 1)
        for byte in command(Command.READ, 8):
            await bench.stream_put(ctx, dut.i, byte)
        ctx.set(dut.i_lost, 1)
        # Until and in the clock in which the answer is taken over.
        await bench.wait_until_low(ctx, ~dut.o.valid)
        ctx.set(dut.i_lost, 0)
        for byte in command(Command.READ, 8):
            await bench.stream_put(ctx, dut.i, byte)

    async def receive(ctx: Any) -> None:
        for _ in range(12):
            found.append(await bench.stream_get(ctx, dut.o))

    bench.run(run, receive)
    assert found == answer(0, status=0x80) + answer(0, status=0x80)
