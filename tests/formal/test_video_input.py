"""The pixels' way in: in memory mode frames are cut from a plain stream, in video mode nothing is touched."""

from pathlib import Path

from amaranth import Cat, Elaboratable, Module, Mux, Signal, Value
from amaranth.hdl import Assert, Assume, Cover

from hdl.axi.video_input import GRAY_PER_WORD, VideoInput
from tests.formal.proofs import held, prove

WIDTH_PX, HEIGHT_PX = 3, 2
FRAME_PX = WIDTH_PX * HEIGHT_PX
"""No whole number of beats of gray."""


class _Framing(Elaboratable):
    """Transfers of any length, in any mode that then stays; of each byte, one bit is looked at."""

    def __init__(self) -> None:
        self.video = VideoInput()
        self.memory_mode, self.gray = Signal(), Signal()
        self.bytes, self.first, self.last = Signal(GRAY_PER_WORD), Signal(), Signal()
        self.ports = [
            self.memory_mode, self.gray, self.bytes, self.first, self.last,
            self.video.i.valid, self.video.o.ready, self.video.i_enable,
        ]  # fmt: skip

    def elaborate(self, platform: object) -> Module:
        m = Module()
        m.submodules.video = video = self.video
        i = video.i
        m.d.comb += [
            video.i_memory_mode.eq(self.memory_mode),
            video.i_gray_input.eq(self.gray),
            video.i_width_px.eq(WIDTH_PX),
            video.i_height_px.eq(HEIGHT_PX),
            Cat(i.payload.data[8 * n] for n in range(GRAY_PER_WORD)).eq(self.bytes),
            i.payload.first.eq(self.first),
            i.payload.last.eq(self.last),
        ]
        before, running = Signal(2), Signal()
        m.d.sync += [running.eq(1), before.eq(Cat(self.memory_mode, self.gray))]
        with m.If(running):
            m.d.comb += Assume(before == Cat(self.memory_mode, self.gray))
        with m.Else():
            # The size has to be there before the first pixel.
            m.d.comb += Assume(~i.valid)
        held(m, Assume, i.valid, i.ready, self.bytes, self.first, self.last)
        self._keeps_what_waits(m)
        self._frames(m)
        return m

    def _keeps_what_waits(self, m: Module) -> None:
        """A pixel that waits stays as it is for as long as pixels are let in."""
        o, waited = self.video.o, Signal()
        m.d.sync += waited.eq(o.valid & ~o.ready)
        pixel = Value.cast(o.payload)
        before = Signal.like(pixel)
        m.d.sync += before.eq(pixel)
        with m.If(waited & self.video.i_enable):
            m.d.comb += Assert(o.valid & (pixel == before))
        with m.If(~self.video.i_enable):
            m.d.comb += Assert(~o.valid & ~self.video.i.ready)

    def _frames(self, m: Module) -> None:
        """Pixels are counted from the start of a frame, and of a beat."""
        i, o = self.video.i, self.video.o
        place, lane, frames, cut = Signal(range(FRAME_PX)), Signal(range(GRAY_PER_WORD)), Signal(2), Signal()
        taken, given = i.valid & i.ready, o.valid & o.ready
        unpacks, ends_frame = self.memory_mode & self.gray, place == FRAME_PX - 1
        data = o.payload.data
        m.d.comb += Assert(given | ~taken)
        with m.If(given):
            m.d.comb += Assert(taken == (~unpacks | ends_frame | (lane == GRAY_PER_WORD - 1)))
            with m.If(~self.memory_mode):
                m.d.comb += Assert(Cat(data[0], data[8], data[16]) == self.bytes[:3])
                m.d.comb += Assert(Cat(o.payload.first, o.payload.last) == Cat(self.first, self.last))
            with m.Else():
                m.d.comb += Assert(o.payload.first == (place == 0))
                m.d.comb += Assert(o.payload.last == ((place % WIDTH_PX) == WIDTH_PX - 1))
                with m.If(self.gray):
                    m.d.comb += Assert(data[0] == self.bytes.bit_select(lane, 1))
                with m.Else():
                    m.d.comb += Assert(Cat(data[16], data[0], data[8]) == self.bytes[:3])
            ends_early = taken & self.last & ~ends_frame
            m.d.sync += [
                place.eq(Mux(ends_frame | ends_early, 0, place + 1)),
                lane.eq(Mux(taken, 0, lane + 1)),
                frames.eq(frames + ends_frame),
                cut.eq(cut | ends_early),
            ]
        m.d.comb += [
            Cover(self.memory_mode & self.gray & (frames == 1) & cut & (place == 1)),
            Cover(self.memory_mode & ~self.gray & (frames == 1) & cut),
            Cover(~self.memory_mode & given & self.first & self.last),
        ]


def test_frames_are_cut_from_transfers(tmp_path: Path) -> None:
    prove(_Framing(), tmp_path)
