"""The pixels' way in: in memory mode frames are cut from a plain stream, in video mode nothing is touched."""

from pathlib import Path

from amaranth import Cat, Elaboratable, Module, Mux, Signal
from amaranth.hdl import Assert, Assume, Cover
from amaranth.lib import wiring

from golden_model.records import Cause
from hdl.axi.video_input import GRAY_PER_WORD, VideoInput
from hdl.frame_admission import FrameAdmission
from tests.formal.proofs import happened, held, prove

WIDTH_PX, HEIGHT_PX = 5, 2
FRAME_PX = WIDTH_PX * HEIGHT_PX
"""No whole number of beats of gray."""


class _Framing(Elaboratable):
    """Transfers of any length, in any mode that then stays; of each byte, one bit is looked at."""

    def __init__(self) -> None:
        self.video, self.admission = VideoInput(video_bits=32), FrameAdmission(closing_lines=1, closing_px=4)
        self.memory_mode, self.gray = Signal(), Signal()
        self.bytes, self.first, self.last = Signal(GRAY_PER_WORD), Signal(), Signal()
        self.ports = [
            self.memory_mode, self.gray, self.bytes, self.first, self.last, self.video.i.valid,
            self.admission.i_may_start, self.admission.i_may_end, self.admission.i_hold, self.admission.i_acceptable,
        ]  # fmt: skip

    def elaborate(self, platform: object) -> Module:
        m = Module()
        m.submodules.video = video = self.video
        m.submodules.admission = admission = self.admission
        wiring.connect(m, video.o, admission.i)
        i = video.i
        m.d.comb += [
            video.i_memory_mode.eq(self.memory_mode),
            video.i_gray_input.eq(self.gray),
            video.i_frame_ends.eq(admission.o_frame_ends),
            admission.i_memory_mode.eq(self.memory_mode),
            admission.i_width_px.eq(WIDTH_PX),
            admission.i_height_px.eq(HEIGHT_PX),
            Cat(i.payload.data[8 * n] for n in range(GRAY_PER_WORD)).eq(self.bytes),
            i.payload.first.eq(self.first),
            i.payload.last.eq(self.last),
        ]
        settings = Cat(self.memory_mode, self.gray, admission.i_acceptable)
        before, running = Signal.like(settings), Signal()
        m.d.sync += [running.eq(1), before.eq(settings)]
        with m.If(running):
            m.d.comb += Assume(before == settings)
        with m.Else():
            # The size has to be there before the first pixel.
            m.d.comb += Assume(~i.valid)
        held(m, Assume, i.valid, i.ready, self.bytes, self.first, self.last)
        place = self._pixels(m)
        self._frames(m, place)
        return m

    def _pixels(self, m: Module) -> Signal:
        """The bytes of each beat in their order; returns the position in the frame in memory mode."""
        i, o, admission = self.video.i, self.video.o, self.admission
        place, lane = Signal(range(FRAME_PX)), Signal(range(GRAY_PER_WORD))
        taken, given = i.valid & i.ready, o.valid & o.ready
        unpacks, ends_frame = self.memory_mode & self.gray, admission.o_running & (place == FRAME_PX - 1)
        data = o.payload.data
        m.d.comb += Assert(given | ~taken)
        with m.If(given):
            m.d.comb += Assert(taken == (~unpacks | ends_frame | (lane == GRAY_PER_WORD - 1)))
            m.d.sync += lane.eq(Mux(taken, 0, lane + 1))
            with m.If(~self.memory_mode):
                m.d.comb += Assert(Cat(data[0], data[8], data[16]) == self.bytes[:3])
                m.d.comb += Assert(Cat(o.payload.first, o.payload.last) == Cat(self.first, self.last))
            with m.Else():
                m.d.comb += Assert(o.payload.last == (self.last & taken))
                with m.If(self.gray):
                    m.d.comb += Assert(data[0] == self.bytes.bit_select(lane, 1))
                with m.Else():
                    m.d.comb += Assert(Cat(data[16], data[0], data[8]) == self.bytes[:3])
            with m.If(self.memory_mode & admission.i_acceptable):
                m.d.sync += place.eq(Mux(ends_frame | o.payload.last, 0, place + 1))
        return place

    def _frames(self, m: Module, place: Signal) -> None:
        """In memory mode a frame starts with the first pixel after a frame or a transfer, and ends with either."""
        admission, o = self.admission, self.video.o
        given, cut = o.valid & o.ready, Signal()
        starts = given & (place == 0) & admission.i_acceptable
        started = Signal()
        m.d.sync += started.eq(starts)
        with m.If(self.memory_mode):
            m.d.comb += Assert(admission.o_start == started)
            with m.If(given & admission.i_acceptable):
                m.d.sync += cut.eq(o.payload.last & (place != FRAME_PX - 1))
            with m.If(admission.o_end):
                expected = Mux(cut, Cause.EARLY_END, Mux(admission.i_acceptable, 0, Cause.INVALID_SETTINGS))
                m.d.comb += Assert(admission.o_causes == expected)
        with m.If(~admission.i_acceptable):
            m.d.comb += Assert(~admission.o.valid & ~admission.o_start)
        ended = happened(m, admission.o_end, most=2)
        m.d.comb += [
            Cover(self.memory_mode & self.gray & (ended == 2) & cut),
            Cover(self.memory_mode & ~self.gray & (ended == 1) & ~cut & (place == 1)),
            Cover(~self.memory_mode & given & self.first & self.last),
            Cover(~admission.i_acceptable & (ended == 2)),
        ]


def test_frames_are_cut_from_transfers(tmp_path: Path) -> None:
    prove(_Framing(), tmp_path)
