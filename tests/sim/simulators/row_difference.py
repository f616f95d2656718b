"""A small real design for the tests of simulators."""

from typing import Any

import numpy as np
from amaranth.hdl import Cat, ClockDomain, ClockSignal, Module, Mux, ResetSignal, Signal
from amaranth.lib import memory, wiring
from amaranth.lib.fifo import SyncFIFOBuffered
from amaranth.lib.wiring import In, Out

from golden_model.arrays import Pixels
from sim.simulators.design import Design, Ports
from sim.simulators.recording import Segment, flatten_frame

WIDTH, HEIGHT = 64, 16
OUTPUT, TAP = "m_axis_difference", "tap_pair"


class RowDifference(wiring.Component):
    """Each pixel minus the one above it plus ``bias``, eight to a word; a packet is ``HEIGHT`` lines."""

    def __init__(self) -> None:
        super().__init__(
            {
                "aclk": In(1),
                "aresetn": In(1),
                "bias": In(8),
                "s_axis_video_tdata": In(24),
                "s_axis_video_tuser": In(1),
                "s_axis_video_tlast": In(1),
                "s_axis_video_tvalid": In(1),
                "s_axis_video_tready": Out(1),
                "m_axis_difference_tdata": Out(64),
                "m_axis_difference_tlast": Out(1),
                "m_axis_difference_tvalid": Out(1),
                "m_axis_difference_tready": In(1),
                "tap_pair_tdata": Out(16),
                "tap_pair_tvalid": Out(1),
            }
        )

    def elaborate(self, platform: object) -> Module:
        m = Module()
        m.domains.sync = ClockDomain()
        m.d.comb += [ClockSignal().eq(self.aclk), ResetSignal().eq(~self.aresetn)]
        line: memory.Memory = memory.Memory(shape=8, depth=WIDTH, init=[])
        m.submodules.line = line
        m.submodules.words = words = SyncFIFOBuffered(width=65, depth=4)
        read, write = line.read_port(), line.write_port()
        x, y = Signal(range(WIDTH)), Signal(range(HEIGHT))
        taken, pixel, valid, end = Signal(), Signal(8), Signal(), Signal()
        word, lane = Signal(64), Signal(3)
        m.d.comb += [
            self.s_axis_video_tready.eq(words.level < 2),
            taken.eq(self.s_axis_video_tvalid & self.s_axis_video_tready),
            Cat(read.addr, read.en).eq(Cat(x, taken)),
            Cat(write.addr, write.en, write.data).eq(Cat(x, taken, self.s_axis_video_tdata[:8])),
        ]
        m.d.sync += [valid.eq(taken), pixel.eq(self.s_axis_video_tdata), end.eq(self.s_axis_video_tlast & (y == 15))]
        with m.If(taken):
            row = Mux(self.s_axis_video_tuser, 0, y)
            m.d.sync += [x.eq(x + 1), y.eq(row)]
            with m.If(self.s_axis_video_tlast):
                m.d.sync += [x.eq(0), y.eq(row + 1)]
        packed = Cat(word[8:], (pixel - read.data + self.bias)[:8])
        with m.If(valid):
            m.d.sync += [word.eq(packed), lane.eq(lane + 1)]
        m.d.comb += [
            words.w_en.eq(valid & (lane == 7)),
            words.w_data.eq(Cat(packed, end)),
            Cat(self.m_axis_difference_tdata, self.m_axis_difference_tlast).eq(words.r_data),
            self.m_axis_difference_tvalid.eq(words.r_rdy),
            words.r_en.eq(self.m_axis_difference_tready),
            self.tap_pair_tvalid.eq(valid),
            self.tap_pair_tdata.eq(Cat(pixel, read.data)),
        ]
        return m


DESIGN = Design("row difference", Ports((OUTPUT,), {"bias": 8}, taps=(TAP,)), RowDifference, identity="")


def segment(images: Pixels, *, bias: int = 0, **changes: Any) -> Segment:
    data, flags = (np.concatenate(part) for part in zip(*map(flatten_frame, images), strict=True))
    values: dict[str, Any] = {"packets": len(images), "cycle_limit": 30_000, **changes}
    return Segment(data, flags, settings={"bias": bias}, **values)


def random_images(count: int) -> Pixels:
    return np.random.default_rng(7).integers(0, 256, (count, HEIGHT, WIDTH)).astype(np.uint8)
