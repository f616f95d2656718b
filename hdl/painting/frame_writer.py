"""A camera's frames into three buffers in memory; the one that is being painted is never overwritten."""

from amaranth import Cat, Const, Module, Mux, Signal, Value
from amaranth.lib import data, fifo, stream, wiring
from amaranth.lib.wiring import In, Out

from golden_model.config import MAX_FRAME_PX
from golden_model.records import WORD_BYTES
from hdl.axi.axi_write import AXI_WRITE, BURST_BYTES, BURST_WORDS, PAGE_BURSTS_LOG2, BurstWriter
from hdl.lib.delay import delayed
from hdl.lib.views import view_signal
from hdl.painting.tiles import FRAME_SIDE
from hdl.settings import PAGE_BYTES

BUFFERS = 3
"""One is painted, one waits to be painted, one is written."""
PIXEL_BYTES = 4
"""Blue, green, red, and one unused."""
BURST_PX = BURST_BYTES // PIXEL_BYTES
"""Rows begin at multiples of this many pixels."""
FRAME_NUMBER = 16
QUEUE_WORDS = 512
"""Pairs of pixels that wait for the memory; at least two bursts."""

VIDEO = data.StructLayout({"valid": 1, "data": 24, "first": 1, "last": 1})
"""A pixel: green in the lowest byte, then blue, red (UG934); whether it starts a frame, whether it ends a line."""
STORED = data.StructLayout({"buffer": range(BUFFERS), "page": 52, "number": FRAME_NUMBER})
"""A frame in memory: its buffer, and where that begins, in pages of 4 KiB; and its number at the writer's input, where
those that are lost count, too, from 1."""


def frame_pages(width_px: int, height_px: int) -> int:
    """Pages of 4 KiB that a buffer needs for a frame."""
    return -(-height_px * -(-width_px // BURST_PX) * BURST_BYTES // PAGE_BYTES)


class FrameWriter(wiring.Component):
    """Writes whole frames, four bytes a pixel, rows padded to 128 bytes; what lies behind a row's end stays as it was.

    The camera never waits. A frame that is shorter than set, that has a line of another length, or of which a pixel
    finds the queue full, is cut off and counted; so is one that starts before this is over. Of a frame with too many
    lines the upper ones are kept, and it is counted as well. A frame that is complete waits at ``o`` until it is taken;
    while it waits, every other is skipped, unless it yields. Switched off, the writer cuts off the frame under way, and
    withdraws the one that waits: it is idle within a few bursts, also when the camera has stopped in a frame.
    """

    i: In(VIDEO)
    i_enable: In(1)
    """Take frames."""
    i_width_px: In(FRAME_SIDE)
    """Size of the frames; may change only while ``o_idle`` and not ``i_enable``, as the next three."""
    i_height_px: In(FRAME_SIDE)
    i_page: In(52)
    """Where the buffers begin, in pages of 4 KiB."""
    i_buffer_pages: In(20)
    """From one buffer to the next, at least `frame_pages`."""
    i_yields: In(1)
    """The frame that waits at ``o`` is given up for the next one that is complete."""
    bus: Out(AXI_WRITE)
    o: Out(stream.Signature(STORED))
    """Complete frames."""
    o_cut: Out(1)
    """A frame has been cut off, or has too many lines."""
    o_failed: Out(1)
    """A frame has been given up, since the memory answered with an error."""
    o_skipped: Out(1)
    """A complete frame has been given up, since another waits at ``o``."""
    o_yielded: Out(1)
    """Another has taken the place of the frame at ``o``."""
    o_idle: Out(1)
    """Nothing is being written."""

    def elaborate(self, platform: object) -> Module:
        """A queue between the camera's side and the memory's."""
        m = Module()
        # A word, and whether the frame ends here incomplete. In front of a frame's pixels is its number.
        m.submodules.waiting = waiting = fifo.SyncFIFOBuffered(width=8 * WORD_BYTES + 1, depth=QUEUE_WORDS)
        m.submodules.bursts = bursts = BurstWriter()
        wiring.connect(m, bursts.bus, wiring.flipped(self.bus))
        is_cut, gives_up = Signal(), Signal()
        is_outside = self._accept(m, waiting, is_cut, gives_up)
        has_stored = self._store(m, waiting, bursts, is_cut, gives_up)
        m.d.comb += self.o_idle.eq(is_outside & has_stored)
        return m

    def _accept(self, m: Module, waiting: fifo.SyncFIFOBuffered, is_cut: Signal, gives_up: Value) -> Value:
        """Queue the words of frames that are as large as set, and a mark where one is cut off; whether none comes."""
        beat = self.i
        x, y, number = Signal(FRAME_SIDE), Signal(FRAME_SIDE), Signal(FRAME_NUMBER)
        left = Signal(8 * PIXEL_BYTES, reset_less=True)
        green, blue, red = (beat.data[low : low + 8] for low in (0, 8, 16))
        pixel = Cat(blue, green, red, Const(0, 8))
        starts = beat.valid & beat.first
        last_x, last_y = delayed(m, self.i_width_px - 1, 1), delayed(m, self.i_height_px - 1, 1)
        ends_line = x == last_x
        # All lines of a frame have been queued, and nothing has come since.
        is_full = Signal()
        with m.If(starts):
            m.d.sync += [number.eq(number + 1), x.eq(1), y.eq(0), left.eq(pixel)]
        with m.Elif(beat.valid):
            m.d.sync += [x.eq(Mux(ends_line, 0, x + 1)), y.eq(y + ends_line), left.eq(pixel)]
        with m.If(beat.valid):
            m.d.sync += is_full.eq(0)
        with m.FSM(name="camera") as camera:
            with m.State("OUTSIDE"):
                m.d.comb += [waiting.w_data.eq(number + 1), waiting.w_en.eq(starts & self.i_enable)]
                m.d.comb += self.o_cut.eq((waiting.w_en & ~waiting.w_rdy) | (is_full & beat.valid & ~beat.first))
                with m.If(waiting.w_en & waiting.w_rdy):
                    m.next = "INSIDE"
            with m.State("INSIDE"):
                # The first pixel of a frame begins a line, which has at least two.
                continues = beat.valid & ~beat.first & (beat.last == ends_line)
                # A pixel that does not belong here is not pushed: behind the frame's last word comes no mark.
                pushes = continues & (x[0] | ends_line)
                m.d.comb += [waiting.w_data.eq(Cat(Mux(x[0], left, pixel), pixel)), waiting.w_en.eq(pushes)]
                completes = pushes & ends_line & (y == last_y)
                with m.If(completes):
                    m.d.sync += is_full.eq(1)
                    m.next = "OUTSIDE"
                stops = ~self.i_enable & ~completes
                with m.If((beat.valid & ~continues) | (pushes & ~waiting.w_rdy) | stops):
                    m.d.comb += self.o_cut.eq(starts & self.i_enable)
                    m.next = "MARK"
            # What is cut off counts when the memory's side gives it up, what starts meanwhile at once.
            with m.State("MARK"):
                m.d.comb += [is_cut.eq(1), waiting.w_data[-1].eq(1), waiting.w_en.eq(1)]
                m.d.comb += self.o_cut.eq(starts & self.i_enable)
                with m.If(waiting.w_rdy):
                    m.next = "GIVEN_UP"
            with m.State("GIVEN_UP"):
                m.d.comb += [is_cut.eq(1), self.o_cut.eq((starts & self.i_enable) | gives_up)]
                with m.If(gives_up):
                    m.next = "OUTSIDE"
        return camera.ongoing("OUTSIDE")

    def _store(
        self, m: Module, waiting: fifo.SyncFIFOBuffered, bursts: BurstWriter, is_cut: Value, gives_up: Signal
    ) -> Value:
        """Write frame after frame; a burst starts when all its words have arrived, or the rest will never come.

        Returns whether nothing is left to write.
        """
        row, burst = Signal(FRAME_SIDE), Signal(PAGE_BURSTS_LOG2 + self.i_buffer_pages.shape().width)
        left_words, needed_words = Signal(range(MAX_FRAME_PX // 2 + 1)), Signal(range(BURST_WORDS + 1))
        broken, failed = Signal(), Signal()
        frame = view_signal(STORED, name="frame")
        row_words = (self.i_width_px + 1) >> 1
        needed = Mux(left_words < BURST_WORDS, left_words, BURST_WORDS)
        # In registers, since much follows the start of a burst; while one is needed, words only come.
        is_enough = delayed(m, waiting.r_level >= needed, 1)
        # While a burst is sent, its row stays.
        is_last = delayed(m, ~left_words.any() & (row == self.i_height_px - 1), 1)
        free = self._free(m)
        marks, is_there = waiting.r_data[-1], waiting.r_rdy & ~broken & needed_words.any()
        m.d.comb += bursts.i_burst.eq(Cat(Const(0, PAGE_BURSTS_LOG2), frame.page) + burst)
        with m.If(bursts.o_error):
            m.d.sync += failed.eq(1)
        with m.FSM(name="memory") as memory:
            with m.State("IDLE"):
                m.d.comb += waiting.r_en.eq(1)
                m.d.sync += [each.eq(0) for each in (row, burst, broken, failed)]
                m.d.sync += [frame.number.eq(waiting.r_data), left_words.eq(row_words), frame.buffer.eq(free)]
                with m.If(waiting.r_rdy):
                    m.next = "PLACE"
            with m.State("PLACE"):
                offset = Mux(frame.buffer[1], self.i_buffer_pages << 1, Mux(frame.buffer[0], self.i_buffer_pages, 0))
                m.d.sync += frame.page.eq(self.i_page + offset)
                m.next = "NEED"
            with m.State("NEED"):
                m.d.sync += needed_words.eq(needed)
                m.next = "WAIT"
            with m.State("WAIT"), m.If(bursts.o_ready & (is_enough | is_cut)):
                m.d.comb += bursts.i_start.eq(1)
                m.d.sync += left_words.eq(left_words - needed_words)
                m.next = "WORDS"
            with m.State("WORDS"):
                m.d.comb += [
                    bursts.i.valid.eq(waiting.r_rdy | broken | ~needed_words.any()),
                    # 0 behind the row's end, not what arrives meanwhile: AXI data must not change while they wait.
                    bursts.i.payload.data.eq(Mux(is_there, waiting.r_data[:-1], 0)),
                    bursts.i.payload.kept.eq(is_there),
                    waiting.r_en.eq(bursts.i.ready & is_there),
                ]
                with m.If(waiting.r_en):
                    m.d.sync += [needed_words.eq(needed_words - 1), broken.eq(marks)]
                with m.If(bursts.o_sent):
                    m.d.sync += burst.eq(burst + 1)
                    m.next = "NEED"
                    with m.If(~left_words.any()):
                        m.d.sync += [row.eq(row + 1), left_words.eq(row_words)]
                    with m.If(broken | is_last):
                        m.next = "ANSWERS"
            with m.State("ANSWERS"), m.If(bursts.o_all_answered):
                self._end(m, frame, broken, failed, gives_up)
        return memory.ongoing("IDLE") & ~waiting.r_rdy

    def _free(self, m: Module) -> Value:
        """A buffer that neither is painted nor waits; the one that was painted last counts until the next is taken."""
        painted = Signal(range(BUFFERS), init=BUFFERS - 1)
        with m.If(self.o.valid & self.o.ready):
            m.d.sync += painted.eq(self.o.payload.buffer)
        with m.If(self.o.ready | ~self.i_enable):
            m.d.sync += self.o.valid.eq(0)
        used = [(painted == n) | (self.o.valid & (self.o.payload.buffer == n)) for n in range(BUFFERS - 1)]
        return Mux(~used[0], 0, Mux(~used[1], 1, 2))

    def _end(self, m: Module, frame: data.View, broken: Value, failed: Value, gives_up: Signal) -> None:
        with m.If(broken):
            # A frame that starts in this clock is counted first.
            m.d.comb += gives_up.eq(~(self.i.valid & self.i.first))
            with m.If(gives_up):
                m.next = "IDLE"
        with m.Else():
            m.next = "IDLE"
            with m.If(failed):
                m.d.comb += self.o_failed.eq(1)
            with m.Elif(self.o.valid & ~self.i_yields):
                m.d.comb += self.o_skipped.eq(1)
            with m.Else():
                m.d.comb += self.o_yielded.eq(self.o.valid & ~self.o.ready)
                m.d.sync += [self.o.valid.eq(1), self.o.payload.eq(frame)]
