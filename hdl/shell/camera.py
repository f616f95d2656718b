"""The camera's side: its pixels cross into the accelerator's clock, and whole frames are admitted or dropped."""

from amaranth import Cat, Const, Module, Mux, Signal, Value
from amaranth.lib import data, fifo, stream, wiring
from amaranth.lib.wiring import In, Out

from golden_model.config import MAX_FRAME_PX
from hdl.axi.video_input import VideoPayload
from hdl.registers.shell_register_map import Reason
from hdl.shell.ring_writer import FRAME_INFO

NUMBER_BITS = 8
RESERVE_PX = 16
"""The queue is nearly full this early, so that the gate cuts a frame off before pixels are lost."""
SETTLING_CLOCKS = 3
"""From an admission to the next decision: by then the shell has counted the buffers that the frame takes."""

CAMERA_BEAT = data.StructLayout({"data": 24, "first": 1, "last": 1, "lost": 1, "number": NUMBER_BITS})
"""A pixel behind the clock crossing: `VideoPayload` and two more fields.

``lost``: the crossing was full and lost pixels just before this one. ``number``: low bits of the frame's number; frames
whose first pixel was lost count, too.
"""


class CameraCrossing(wiring.Component):
    """Passes a pixel per clock from the domain ``camera`` to ``sync``.

    Between them is Amaranth's asynchronous FIFO. While it is full, pixels are lost, and the next one says so.

    Parameters
    ----------
    video_bits : {24, 8}
        Bits of a pixel.
    depth : int
        Pixels in the queue, a power of two, at least 32.
    """

    i_valid: In(1)
    """In ``camera``, as ``i``."""
    i: In(VideoPayload)
    """A pixel; there is no ready, since a camera does not wait."""
    o: Out(stream.Signature(CAMERA_BEAT))
    o_pressed: Out(1)
    """The queue is nearly full."""

    def __init__(self, *, video_bits: int, depth: int) -> None:
        self.video_bits = video_bits
        self.depth = depth
        super().__init__()

    def elaborate(self, platform: object) -> Module:
        """Number the frames and mark gaps on the camera's side of the queue."""
        m = Module()
        # The queue is only as wide as its pixels: gray needs 8 of the 24 bits.
        width = CAMERA_BEAT.size - 24 + self.video_bits
        # Buffered: without an output register, the way from its memory through the gate and back is the longest of all.
        queue = fifo.AsyncFIFOBuffered(width=width, depth=self.depth, r_domain="sync", w_domain="camera")
        m.submodules.queue = queue
        lost = Signal()
        number = Signal(NUMBER_BITS)
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
            # The pixel that found the queue full is lost; the next one that finds room says so.
            m.d.camera += [number.eq(this_number), lost.eq(~queue.w_rdy)]
        m.d.sync += self.o_pressed.eq(queue.r_level >= self.depth - RESERVE_PX)
        return m


class CameraGate(wiring.Component):
    """Passes or drops whole frames; the camera never waits.

    A frame is dropped at its first pixel, for one of the reasons in `Reason`. An admitted frame is cut off where a line
    has the wrong length, where pixels are lost, where the next frame starts, or where the accelerator is busy while the
    queue before the gate is nearly full. The accelerator makes a bad frame of it.

    The frame after one with more pixels than its size is dropped: a camera with more lines than the setting delivers
    one good frame of its upper lines, then none.
    """

    i: In(stream.Signature(CAMERA_BEAT))
    i_pressed: In(1)
    """The queue is nearly full."""
    i_on: In(1)
    """Frames are requested. Without, a frame that starts is dropped, and one in progress is cut off."""
    i_refused: In(1)
    """The settings are invalid: a frame that starts is dropped."""
    i_has_room: In(1)
    """There are buffers for another frame. Without, a frame that starts is dropped."""
    i_width_px: In(range(MAX_FRAME_PX + 1))
    """Sampled with each first pixel."""
    i_height_px: In(range(MAX_FRAME_PX + 1))
    """Sampled with each first pixel."""
    i_time: In(64)
    o: Out(stream.Signature(VideoPayload))
    """Its ready must not depend on its valid. What is offered may be withdrawn."""
    o_admits: Out(1)
    """High in the clock in which an admitted frame's first pixel is taken."""
    o_info: Out(FRAME_INFO)
    """The frame's number and time, with ``o_admits``."""
    o_drops: Out(1)
    """High in the clock in which a frame is dropped or cut, other than for `Reason.OFF`."""
    o_frames: Out(32)
    """Frames that have started since reset."""
    o_dropped: Out(32)
    """Frames that were dropped since reset."""
    o_cut: Out(32)
    """Admitted frames that were cut off since reset."""
    o_last_drop: Out(FRAME_INFO)
    """The frame dropped last."""
    o_reason: Out(8)
    """Its `Reason`."""

    latency_cycles = 0

    def elaborate(self, platform: object) -> Module:
        """Decide at each first pixel, check the frame's lines, count frames."""
        m = Module()
        beat = self.i.payload
        running = Signal()
        settled = Signal(init=1)
        takes = Signal()
        passes = Signal()
        gives_up = Signal()
        line_ends, frame_ends, is_surplus = self._track_position(m, takes)
        reason = self._reason(m, is_surplus)
        fits = ~beat.lost & (beat.last == line_ends) & ~is_surplus
        m.d.comb += [
            gives_up.eq(self.i_pressed & ~self.o.ready),
            passes.eq(Mux(beat.first, reason == 0, running & fits & self.i_on) & ~gives_up),
            self.o.valid.eq(self.i.valid & passes & settled),
            self.o.payload.eq(Cat(beat.data, Const(0, 8), beat.first, beat.last)),
            self.i.ready.eq(settled & (self.o.ready | ~passes)),
            takes.eq(self.i.valid & self.i.ready),
            self.o_admits.eq(takes & beat.first & passes),
        ]
        with m.If(takes):
            # A first pixel that also ends its line breaks its frame at once.
            m.d.sync += running.eq(passes & ~frame_ends & ~(beat.first & beat.last))
        cuts = takes & ((running & (beat.first | ~passes)) | (self.o_admits & beat.last))
        with m.If(cuts):
            m.d.sync += self.o_cut.eq(self.o_cut + 1)
        self._settle(m, settled)
        self._number(m, takes, Mux(gives_up & (reason == 0), Reason.OUTRUN, reason), cuts)
        return m

    def _track_position(self, m: Module, takes: Value) -> tuple[Value, Value, Value]:
        """Whether the pixel ends a line, whether it ends the frame, and whether the frame has ended before it."""
        beat = self.i.payload
        x = Signal(range(MAX_FRAME_PX))
        y = Signal(range(MAX_FRAME_PX))
        last_x = Signal(range(MAX_FRAME_PX))
        last_y = Signal(range(MAX_FRAME_PX))
        line_ends = Signal()
        last_line = Signal()
        ended = Signal(init=1)
        broken = Signal(init=1)
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
                    # After a broken line the count of lines is wrong: more pixels then prove no larger frame.
                    broken.eq(broken | beat.lost | (~ended & (beat.last != line_ends))),
                    surplus.eq(surplus | (ended & ~broken)),
                ]
        return line_ends, frame_ends, Mux(beat.first, surplus, ended)

    def _reason(self, m: Module, is_surplus: Value) -> Value:
        """Why a frame that starts with this pixel is dropped; 0: it is admitted."""
        # This register, for which `SETTLING_CLOCKS` leave time, keeps the settings' checks out of the pixels' path.
        known = Signal(range(max(Reason) + 1), init=Reason.OFF)
        full = Mux(self.i_has_room, 0, Reason.NO_BUFFER)
        m.d.sync += known.eq(Mux(self.i_on, Mux(self.i_refused, Reason.REFUSED, full), Reason.OFF))
        return Mux(known.any() | ~is_surplus, known, Reason.TOO_LARGE)

    def _settle(self, m: Module, settled: Signal) -> None:
        """Take no pixel for `SETTLING_CLOCKS` after an admission."""
        clocks = Signal(range(SETTLING_CLOCKS))
        m.d.sync += clocks.eq(Mux(settled, 0, clocks + 1))
        with m.If(self.o_admits):
            m.d.sync += settled.eq(0)
        with m.Elif(clocks == SETTLING_CLOCKS - 1):
            m.d.sync += settled.eq(1)

    def _number(self, m: Module, takes: Value, reason: Value, cuts: Value) -> None:
        """Count frames by their numbers, since the crossing may have lost the first pixel of some."""
        beat = self.i.payload
        newer = Signal(NUMBER_BITS)
        number = Signal(32)
        # This frame, unless it is admitted, and every frame before it of which no pixel arrived.
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
