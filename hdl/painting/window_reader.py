"""The part of a frame that a tile needs, from memory into a window."""

from amaranth import Cat, Const, Module, Mux, Signal, Value
from amaranth.lib import data, stream, wiring
from amaranth.lib.wiring import In, Out

from hdl.axi.axi_read import AXI_READ, BURST_PART, BurstReader
from hdl.axi.axi_write import BURST_WORDS, PAGE_BURSTS_LOG2
from hdl.lib.delay import delayed
from hdl.lib.multiplier import Multiplier, multiply
from hdl.lib.views import view_signal
from hdl.painting.frame_writer import BURST_PX, PIXEL_BYTES
from hdl.painting.positions import LOADED_TILE
from hdl.painting.sampling import WINDOW_WRITE, window_column
from hdl.painting.tiles import FRAME_SIDE
from hdl.painting.windows import PLAN

WORD_LOG2 = (BURST_WORDS - 1).bit_length()
PLACE_CYCLES = Multiplier.latency_cycles + 2
"""From a plan to where its window begins in memory."""


class WindowReader(wiring.Component):
    """Reads the window of each plan, row by row, and passes the tile on when all of it is there.

    While the tile at ``o`` is painted, the window of the next is read; so ``o`` is taken when the window has been read
    for the last time, or two clocks before. A ``wide`` window takes the place of both: it is read when no tile is at
    ``o``, and while its own tile is there no other is. Of a plan that is ``blank`` nothing is read; one of which a word
    came with an error becomes blank, so that no wrong pixel is painted.
    """

    i: In(stream.Signature(PLAN))
    i_width_px: In(FRAME_SIDE)
    """Width of the frame; constant while it is painted, as the next."""
    i_page: In(52)
    """Where the frame begins, in pages of 4 KiB; in rows as `hdl.painting.frame_writer.FrameWriter` pads them."""
    bus: Out(AXI_READ)
    o: Out(stream.Signature(LOADED_TILE))
    o_write: Out(WINDOW_WRITE)
    """To the windows' memory."""
    o_failed: Out(1)
    """A tile becomes blank."""
    o_error: Out(1)
    """A word comes with an error."""

    def elaborate(self, platform: object) -> Module:
        """Take a plan, read its window, pass it on."""
        m = Module()
        m.submodules.reader = reader = BurstReader()
        wiring.connect(m, reader.bus, wiring.flipped(self.bus))
        plan = view_signal(PLAN, name="plan", reset_less=True)
        window, failed = Signal(), Signal()
        m.d.comb += self.o_error.eq(reader.o_error)
        takes = self.i.valid & self.i.ready & ~self.i.payload.blank
        begins = delayed(m, takes, PLACE_CYCLES, reset_less=False)
        self._ask(m, reader.i, plan, begins)
        is_read = self._receive(m, reader.o, plan, begins, window)
        with m.If(reader.o_error):
            m.d.sync += failed.eq(1)
        with m.If(self.o.ready):
            m.d.sync += self.o.valid.eq(0)
        with m.FSM():
            with m.State("IDLE"):
                shares = self.i.payload.blank | ~(self.i.payload.wide | self.o.payload.wide)
                m.d.comb += self.i.ready.eq(shares | ~self.o.valid)
                m.d.sync += [plan.eq(self.i.payload), failed.eq(0)]
                with m.If(self.i.valid & self.i.ready):
                    m.next = "READ"
                    with m.If(self.i.payload.blank):
                        m.next = "PASS"
            with m.State("READ"), m.If(is_read):
                m.next = "PASS"
            with m.State("PASS"), m.If(~self.o.valid | self.o.ready):
                m.d.comb += self.o_failed.eq(failed)
                m.d.sync += [
                    self.o.valid.eq(1),
                    self.o.payload.corners.eq(plan.corners),
                    self.o.payload.window.eq(window),
                    self.o.payload.wide.eq(plan.wide),
                    self.o.payload.blank.eq(plan.blank | failed),
                    window.eq(~window),
                ]
                m.next = "IDLE"
        return m

    def _ask(self, m: Module, bursts: stream.Interface, plan: data.View, begins: Value) -> None:
        """Ask for the bursts of each row: from the one with its leftmost word to the one with its rightmost."""
        left, right = plan.left[1:], plan.right[1:]
        y, column = Signal.like(plan.top), Signal(len(left) - WORD_LOG2)
        row = Signal(BURST_PART["burst"].shape, reset_less=True)
        row_bursts = (self.i_width_px + BURST_PX - 1) >> (BURST_PX - 1).bit_length()
        above = multiply(m, "above", self.i.payload.top, row_bursts)
        # The row's first burst, two clocks after the product.
        page = Cat(Const(0, PAGE_BURSTS_LOG2), self.i_page)
        first = delayed(m, page + delayed(m, above + left[WORD_LOG2:], 1), 1)
        ends_row = column == delayed(m, right[WORD_LOG2:] - left[WORD_LOG2:], 1)
        m.d.comb += [
            bursts.payload.burst.eq(row + column),
            bursts.payload.first.eq(Mux(column == 0, left[:WORD_LOG2], 0)),
            bursts.payload.last.eq(Mux(ends_row, right[:WORD_LOG2], BURST_WORDS - 1)),
        ]
        with m.If(begins):
            m.d.sync += [bursts.valid.eq(1), y.eq(plan.top), column.eq(0), row.eq(first)]
        with m.Elif(bursts.valid & bursts.ready):
            m.d.sync += column.eq(column + 1)
            with m.If(ends_row):
                m.d.sync += [column.eq(0), y.eq(y + 1), row.eq(row + row_bursts), bursts.valid.eq(y != plan.bottom)]

    def _receive(self, m: Module, words: stream.Interface, plan: data.View, begins: Value, window: Value) -> Value:
        """Write the words into the window; returns whether this clock's is the last."""
        left, right = plan.left[1:], plan.right[1:]
        x, y = Signal(len(left)), Signal.like(plan.top)
        write, pixel_bits = self.o_write, 8 * PIXEL_BYTES
        ends_row = x == right
        m.d.comb += [
            words.ready.eq(1),
            write.valid.eq(words.valid),
            write.x.eq(window_column(x, plan.wide, window)),
            write.y.eq(y),
            # A window of 64 px that begins at an odd x has 33 words, of which the last has the address of the first. So
            # its right half is left out; the left half of the first is overwritten. A wide one of 128 px likewise.
            write.kept.eq(Mux(ends_row & ~plan.right[0], 0b01, 0b11)),
            *(write.pixels[n].eq(words.payload.data.word_select(n, pixel_bits)) for n in range(2)),
        ]
        with m.If(begins):
            m.d.sync += [x.eq(left), y.eq(plan.top)]
        with m.Elif(words.valid):
            m.d.sync += [x.eq(Mux(ends_row, left, x + 1)), y.eq(y + ends_row)]
        return Value.cast(words.valid & ends_row & (y == plan.bottom))
