# amaranth: UnusedElaboratable=no
"""The top at its pins: light-emitting diodes and the button; commands and answers are in `test_link`."""

import dataclasses
from collections.abc import Callable, Coroutine
from types import SimpleNamespace
from typing import Any

import pytest
from amaranth import Module, Signal
from amaranth.lib import stream, wiring
from amaranth.lib.wiring import In, Out
from amaranth.sim import Simulator

from hdl.axi.axi_lite import AXI_LITE
from hdl.axi.video_input import VideoPayload
from hdl.build import BUILDS, Build
from hdl.serial import ulx3s
from hdl.serial.link import Command
from hdl.streams import WordPayload

BUILD = dataclasses.replace(BUILDS["tiny"], shell="serial", video_bits=8)


def simulate(dut: ulx3s.Ulx3s, run: Callable[[Any], Coroutine[Any, Any, None]]) -> None:
    async def oscillator(ctx: Any) -> None:
        while True:
            for level in (1, 0):
                ctx.set(dut.clk_25mhz, level)
                await ctx.delay(0.5 / ulx3s.CLOCK_HZ)

    simulator = Simulator(dut)
    simulator.add_testbench(run)
    simulator.add_testbench(oscillator, background=True)
    simulator.run()


class IdleAccelerator(wiring.Component):
    """The ports of an accelerator, and nothing that drives its outputs."""

    i_reset: In(1)
    control: In(AXI_LITE)
    i_video: In(stream.Signature(VideoPayload))
    o_features: Out(stream.Signature(WordPayload))
    o_matches: Out(stream.Signature(WordPayload))

    def __init__(self, build: Build) -> None:
        self.build = build
        self.registers = SimpleNamespace(o_enable=Signal())
        super().__init__()

    def elaborate(self, platform: object) -> Module:
        return Module()


def test_each_light_has_its_place_and_the_button_resets(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ulx3s, "Accelerator", IdleAccelerator)
    dut = ulx3s.Ulx3s(BUILD)
    idle = dut.accelerator

    async def run(ctx: Any) -> None:
        ctx.set(dut.ftdi_txd, 1)
        # The configuration of the board begins with a reset.
        for _ in range(ulx3s.RESET_CLOCKS):
            assert ctx.get(idle.i_reset)
            await ctx.posedge(dut.clk_25mhz)
            await ctx.delay(1e-9)
        assert not ctx.get(idle.i_reset)
        for n, signal in ((0, idle.registers.o_enable), (2, idle.o_features.valid), (3, idle.o_matches.valid)):
            ctx.set(signal, 1)
            await ctx.posedge(dut.clk_25mhz)
            assert ctx.get(dut.led) == 1 << n
            ctx.set(signal, 0)
        # A byte that does not end.
        ctx.set(dut.ftdi_txd, 0)
        for _ in range(ulx3s.RESET_CLOCKS + 11 * ulx3s.CLOCKS_PER_BIT):
            await ctx.posedge(dut.clk_25mhz)
        assert ctx.get(dut.led) == 1 << 1
        assert not ctx.get(idle.i_reset)
        ctx.set(dut.btn_fire1, 1)
        for _ in range(8):
            await ctx.posedge(dut.clk_25mhz)
        assert ctx.get(idle.i_reset)

    simulate(dut, run)


def test_a_whole_frame_and_its_commands_wait_and_one_byte_more_is_lost(monkeypatch: pytest.MonkeyPatch) -> None:
    frame_px, space, clocks_per_bit = 4 * 3, 4, 4
    monkeypatch.setattr(ulx3s, "Accelerator", IdleAccelerator)
    monkeypatch.setattr(ulx3s, "COMMAND_SPACE", space)
    monkeypatch.setattr(ulx3s, "CLOCKS_PER_BIT", clocks_per_bit)
    dut = ulx3s.Ulx3s(BUILD)
    build = SimpleNamespace(max_width_px=4, max_height_px=3, outputs=("features", "matches"))
    monkeypatch.setattr(dut.accelerator, "build", build)

    async def send(ctx: Any, byte: int) -> None:
        for bit in (0, *(byte >> n & 1 for n in range(8)), 1, 1):
            ctx.set(dut.ftdi_txd, bit)
            for _ in range(clocks_per_bit):
                await ctx.posedge(dut.clk_25mhz)

    async def run(ctx: Any) -> None:
        ctx.set(dut.ftdi_txd, 1)
        for _ in range(ulx3s.RESET_CLOCKS):
            await ctx.posedge(dut.clk_25mhz)
        # The accelerator takes no pixel: all behind the command wait.
        for byte in (Command.PIXELS, 0xFF, 0xFF, *range(frame_px + space)):
            await send(ctx, byte)
        assert ctx.get(dut.led) == 0
        await send(ctx, 0)
        assert ctx.get(dut.led) == 1 << 1

    simulate(dut, run)
