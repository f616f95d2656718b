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


def test_the_port_has_the_rate_that_hosts_open_it_with() -> None:
    assert (ulx3s.BAUD, ulx3s.CLOCK_HZ, ulx3s.COMMAND_SPACE, ulx3s.CLOCKS_PER_BIT) == (1_000_000, 25_000_000, 64, 25)


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
