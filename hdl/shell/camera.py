"""The camera's side: its pixels cross into the accelerator's clock, and whole frames are admitted or dropped."""

from __future__ import annotations

from amaranth import Cat, Module, Mux, Signal, Value
from amaranth.lib import data, fifo, stream, wiring
from amaranth.lib.wiring import In, Out

from golden_model.config import MAX_FRAME_PX
from hdl.axi.video_input import VideoPayload
from hdl.registers.live_register_map import Reason
from hdl.shell.ring_writer import FRAME_INFO

NUMBER_BITS = 8
SETTLING_CLOCKS = 3
"""From an admission to the next decision: what the admission takes has been counted by then."""


CAMERA_BEAT = data.StructLayout({"data": 24, "first": 1, "last": 1, "lost": 1, "number": NUMBER_BITS})
"""A pixel behind the clock crossing: `VideoPayload`, and ``lost``: pixels were lost just before this one, because the
crossing was full; ``number``: low bits of the number of its frame, which counts frames whose first pixel was lost."""


class CameraCrossing(wiring.Component):
    """Takes a pixel in every clock of the domain ``camera``, and offers it in ``sync``.

    The queue between is Amaranth's asynchronous FIFO. Where it is full, pixels are lost and the next one says so.

    Parameters
    ----------
    video_bits : {24, 8}
        Bits of a pixel.
    depth : int
        Pixels in the queue, a power of two, at least 32.

    Members
    -------
    i_valid : In(1), i : In(VideoPayload)
        In ``camera``: there is no ready, since a camera does not wait.
    o : Out(stream of CAMERA_BEAT)
    o_pressed : Out(1)
        The queue is nearly full.
    """

    i_valid: Signal
    i: data.View
    o: stream.Interface
    o_pressed: Signal

    def __init__(self, *, video_bits: int, depth: int) -> None:
        self.video_bits = video_bits
        self.depth = depth
        super().__init__(
            {
                "i_valid": In(1),
                "i": In(VideoPayload),
                "o": Out(stream.Signature(CAMERA_BEAT)),
                "o_pressed": Out(1),
            }
        )

    def elaborate(self, platform: object) -> Module:
        """Number the pixels' frames and mark gaps before the queue."""
        m = Module()
        width = CAMERA_BEAT.size - 24 + self.video_bits
        m.submodules.queue = queue = fifo.AsyncFIFO(width=width, depth=self.depth, r_domain="sync", w_domain="camera")
        lost, number = Signal(), Signal(NUMBER_BITS)
        this_number = Signal.like(number)
        m.d.comb += [
            this_number.eq(number + self.i.first),
            queue.w_en.eq(self.i_valid),
            queue.w_data.eq(Cat(self.i.first, self.i.last, lost, this_number, self.i.data[: self.video_bits])),
            Cat(self.o.payload.first, self.o.payload.last, self.o.payload.lost, self.o.payload.number).eq(queue.r_data),
            self.o.payload.data.eq(queue.r_data[-self.video_bits :]),
            self.o.valid.eq(queue.r_rdy),
            queue.r_en.eq(self.o.ready),
        ]
        with m.If(self.i_valid):
            m.d.camera += [number.eq(this_number), lost.eq(~queue.w_rdy)]
        m.d.sync += self.o_pressed.eq(queue.r_level >= self.depth - 16)
        return m


class CameraGate(wiring.Component):
    """Passes whole frames of the size that is set, and drops whole frames; it never lets the camera wait.

    A frame is dropped at its first pixel for one of the reasons in `Reason`. An admitted frame is cut off where it
    breaks a line of its size, loses pixels, meets the next frame, or finds the accelerator busy while the queue before
    the gate is nearly full; the accelerator makes a bad frame of it. After a frame with more pixels than its size, the
    next one is dropped: a camera that is set to more lines gives one good frame of its upper lines, then none.

    Members
    -------
    i : In(stream of CAMERA_BEAT)
    i_pressed : In(1)
        The queue is nearly full.
    i_on, i_refused, i_has_room : In(1)
        Frames are wanted; the settings cannot work; there are buffers for another frame. Where they are 0, 1 and 0, a
        frame that starts is dropped.
    i_width_px, i_height_px : In
        Sampled with each first pixel.
    i_time : In(64)
    o : Out(stream of VideoPayload)
        Its ready must not depend on its valid. What is offered may be withdrawn.
    o_admits : Out(1), o_info : Out(FRAME_INFO)
        In the clock in which an admitted frame's first pixel is taken.
    o_drops : Out(1)
        In the clock in which a frame is dropped or cut, other than for `Reason.OFF`.
    o_frames, o_dropped, o_cut : Out(32)
        Frames since reset: ``o_frames`` have started, of which ``o_dropped`` were dropped; ``o_cut`` of the others.
    o_last_drop : Out(FRAME_INFO), o_reason : Out(8)
        Of the frame dropped last.

    Attributes
    ----------
    latency_cycles : int
    """

    i: stream.Interface
    i_pressed: Signal
    i_on: Signal
    i_refused: Signal
    i_has_room: Signal
    i_width_px: Signal
    i_height_px: Signal
    i_time: Signal
    o: stream.Interface
    o_admits: Signal
    o_info: data.View
    o_drops: Signal
    o_frames: Signal
    o_dropped: Signal
    o_cut: Signal
    o_last_drop: data.View
    o_reason: Signal

    latency_cycles = 0

    def __init__(self) -> None:
        super().__init__(
            {
                "i": In(stream.Signature(CAMERA_BEAT)),
                "i_pressed": In(1),
                "i_on": In(1),
                "i_refused": In(1),
                "i_has_room": In(1),
                "i_width_px": In(range(MAX_FRAME_PX + 1)),
                "i_height_px": In(range(MAX_FRAME_PX + 1)),
                "i_time": In(64),
                "o": Out(stream.Signature(VideoPayload)),
                "o_admits": Out(1),
                "o_info": Out(FRAME_INFO),
                "o_drops": Out(1),
                "o_frames": Out(32),
                "o_dropped": Out(32),
                "o_cut": Out(32),
                "o_last_drop": Out(FRAME_INFO),
                "o_reason": Out(8),
            }
        )

    def elaborate(self, platform: object) -> Module:
        """Decide at each first pixel, follow the frame, count."""
        m = Module()
        beat = self.i.payload
        running, settled = Signal(), Signal(init=1)
        takes, passes, gives_up = Signal(), Signal(), Signal()
        line_ends, is_whole, is_surplus = self._follow(m, takes)
        reason = self._reason(m, is_surplus)
        fits = ~beat.lost & (beat.last == line_ends) & ~is_surplus
        m.d.comb += [
            gives_up.eq(self.i_pressed & ~self.o.ready),
            passes.eq(Mux(beat.first, reason == 0, running & fits & self.i_on) & ~gives_up),
            self.o.valid.eq(self.i.valid & passes & settled),
            self.o.payload.eq(Cat(beat.data, Signal(8), beat.first, beat.last)),
            self.i.ready.eq(settled & (self.o.ready | ~passes)),
            takes.eq(self.i.valid & self.i.ready),
            self.o_admits.eq(takes & beat.first & passes),
        ]
        with m.If(takes):
            m.d.sync += running.eq(passes & ~is_whole & ~(beat.first & beat.last))
        cuts = takes & ((running & (beat.first | ~passes)) | (self.o_admits & beat.last))
        with m.If(cuts):
            m.d.sync += self.o_cut.eq(self.o_cut + 1)
        self._settle(m, settled)
        self._number(m, takes, Mux(gives_up & (reason == 0), Reason.OUTRUN, reason), cuts)
        return m

    def _follow(self, m: Module, takes: Value) -> tuple[Value, Value, Value]:
        """Whether the pixel ends a line, whether it ends the frame, and whether the frame had ended before it."""
        beat = self.i.payload
        x, y, last_x, last_y = (Signal(range(MAX_FRAME_PX)) for _ in range(4))
        line_ends, last_line, ended, broken = Signal(), Signal(), Signal(init=1), Signal(init=1)
        surplus = Signal()
        m.d.comb += [line_ends.eq(~beat.first & (x == last_x)), last_line.eq(y == last_y)]
        frame_ends = line_ends & last_line & ~ended
        with m.If(takes):
            m.d.sync += x.eq(Mux(line_ends, 0, x + 1))
            with m.If(beat.first):
                m.d.sync += [
                    *(signal.eq(value) for signal, value in ((x, 1), (y, 0), (ended, 0), (surplus, 0))),
                    broken.eq(beat.last),
                    last_x.eq(self.i_width_px - 1),
                    last_y.eq(self.i_height_px - 1),
                ]
            with m.Else():
                m.d.sync += [
                    y.eq(y + line_ends),
                    ended.eq(ended | frame_ends),
                    # Where a line was broken, the count of lines says nothing.
                    broken.eq(broken | beat.lost | (~ended & (beat.last != line_ends))),
                    surplus.eq(surplus | (ended & ~broken)),
                ]
        return line_ends, frame_ends, Mux(beat.first, surplus, ended)

    def _reason(self, m: Module, is_surplus: Value) -> Value:
        """Why a frame that starts with this pixel is dropped; 0: it is admitted."""
        known = Signal(range(max(Reason) + 1), init=Reason.OFF)
        full = Mux(self.i_has_room, 0, Reason.NO_BUFFER)
        m.d.sync += known.eq(Mux(self.i_on, Mux(self.i_refused, Reason.REFUSED, full), Reason.OFF))
        return Mux(known.any() | ~is_surplus, known, Reason.TOO_LARGE)

    def _settle(self, m: Module, settled: Signal) -> None:
        """No pixel is taken for some clocks after an admission."""
        clocks = Signal(range(SETTLING_CLOCKS))
        m.d.sync += clocks.eq(Mux(settled, 0, clocks + 1))
        with m.If(self.o_admits):
            m.d.sync += settled.eq(0)
        with m.Elif(clocks == SETTLING_CLOCKS - 1):
            m.d.sync += settled.eq(1)

    def _number(self, m: Module, takes: Value, reason: Value, cuts: Value) -> None:
        """Count frames by their numbers, since the first pixel of some may be lost."""
        beat = self.i.payload
        newer = Signal(NUMBER_BITS)
        number = Signal(32)
        # A frame that is not admitted and every frame of which nothing was seen.
        drops = Signal(NUMBER_BITS)
        m.d.comb += [
            newer.eq(beat.number - self.o_frames[:NUMBER_BITS]),
            number.eq(self.o_frames + newer),
            self.o_info.number.eq(number),
            self.o_info.time.eq(self.i_time),
            drops.eq(newer - self.o_admits),
            self.o_drops.eq(self.i_on & (cuts | (takes & drops.any()))),
        ]
        with m.If(takes):
            m.d.sync += [self.o_frames.eq(number), self.o_dropped.eq(self.o_dropped + drops)]
            with m.If(drops.any()):
                m.d.sync += self.o_reason.eq(Mux(beat.first & ~self.o_admits, reason, Reason.OUTRUN))
                m.d.sync += [self.o_last_drop.number.eq(number - self.o_admits), self.o_last_drop.time.eq(self.i_time)]
