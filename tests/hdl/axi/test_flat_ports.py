from typing import Any

import pytest
from amaranth import Module, Signal
from amaranth.lib import data, stream
from amaranth.lib.wiring import In, Out
from amaranth.sim import Simulator

from hdl.axi.axi_lite import AXI_LITE
from hdl.axi.axi_read import AXI_READ
from hdl.axi.axi_write import AXI_WRITE
from hdl.axi.flat_ports import FlatTop, bus_pins, packet_pins, stream_pins
from hdl.streams import WordPayload

PACKETS = stream.Signature(WordPayload)
VIDEO = stream.Signature(data.StructLayout({"data": 24, "first": 1, "last": 1}))


_BURST = "addr:64 len:8 size:3 burst:2 cache:4 prot:3 valid ready<"
_LITE, _ANSWER = "addr:12 prot:3 valid ready<", "resp:2< valid< ready"
BUSES = {
    "lite": (AXI_LITE, (_LITE, "data:32 strb:4 valid ready<", _ANSWER, _LITE, "data:32< resp:2< valid< ready")),
    "write": (AXI_WRITE, (_BURST, "data:64 strb:8 last valid ready<", _ANSWER, "", "")),
    "read": (AXI_READ, ("", "", "", _BURST, "data:64< resp:2< last< valid< ready")),
}
"""Signals with their widths, in the channels aw, w, b, ar and r; `<`: towards the manager."""


@pytest.mark.parametrize("bus", BUSES)
def test_the_channels_of_a_bus_have_the_signals_of_axi(bus: str) -> None:
    signature, channels = BUSES[bus]
    expected = {}
    for channel, signals in zip(("aw", "w", "b", "ar", "r"), channels, strict=True):
        for name, _, bits in (each.rstrip("<").partition(":") for each in signals.split()):
            flow = In if {f"{name}<", f"{name}:{bits}<"} & {*signals.split()} else Out
            expected[f"{channel}{name}"] = flow(int(bits or 1))
    assert dict(signature.members.items()) == expected


class _Top(FlatTop):
    def __init__(self) -> None:
        self.video, self.packets = VIDEO.create(), PACKETS.create()
        video = self.video.payload
        pins = stream_pins("s_axis_video", self.video, In, tdata=video.data, tuser=video.first)
        super().__init__({**pins, **packet_pins("m_axis_out", self.packets)})

    def elaborate(self, platform: object) -> Module:
        m = Module()
        self.connect_pins(m)
        m.d.comb += [
            self.packets.payload.data.eq(self.video.payload.data + self.video.payload.first),
            self.packets.payload.last.eq(self.video.payload.last),
            self.packets.valid.eq(self.video.valid),
            self.video.ready.eq(self.packets.ready),
        ]
        return m


def test_values_pass_the_ports_in_their_directions() -> None:
    top = _Top()
    inputs = {name for name, member in top.signature.members.items() if member.flow == In}
    assert inputs == {*(f"s_axis_video_{name}" for name in ("tdata", "tuser", "tlast", "tvalid")), "m_axis_out_tready"}
    assert len(top.s_axis_video_tdata) == 24
    found: list[int] = []

    async def run(ctx: Any) -> None:
        sent = {"s_axis_video_tdata": 41, "s_axis_video_tuser": 1, "s_axis_video_tvalid": 1, "m_axis_out_tready": 1}
        for name, value in sent.items():
            ctx.set(getattr(top, name), value)
        outputs = ("m_axis_out_tdata", "m_axis_out_tkeep", "m_axis_out_tlast", "m_axis_out_tvalid")
        found.extend(ctx.get(getattr(top, name)) for name in (*outputs, "s_axis_video_tready"))

    simulator = Simulator(top)
    simulator.add_testbench(run)
    simulator.run()
    assert found == [42, 0xFF, 0, 1, 1]


def test_a_bus_has_a_pin_for_every_member_in_its_direction() -> None:
    bus = AXI_LITE.create()
    pins = bus_pins("s_axi_ctrl", bus)
    assert pins.keys() == {f"s_axi_ctrl_{name}" for name in AXI_LITE.members}
    member, value = pins["s_axi_ctrl_awaddr"]
    assert (member.flow, value) == (Out, bus.awaddr)
    assert pins["s_axi_ctrl_rdata"][0].flow == In
    assert isinstance(pins["s_axi_ctrl_rdata"][1], Signal)
