"""Reads the canvas in lines, as a display needs it: words of tiles in, AXI4-Stream video out."""

from amaranth import Cat, Module, Mux, Signal, Value
from amaranth.lib import data, fifo, stream, wiring
from amaranth.lib.wiring import In, Out

from golden_model.painting.tiles import MAX_TILES, TILE_PX
from golden_model.records import WORD_BYTES
from hdl.axi.axi_read import BURST_PART, READ_WORD, BurstReader
from hdl.axi.axi_write import BURST_WORDS
from hdl.lib.delay import delayed
from hdl.lib.views import view_signal
from hdl.painting.canvas_port import HOLD
from hdl.painting.frame_writer import PIXEL_BYTES

LINES = range(MAX_TILES * TILE_PX + 1)
PICTURE = data.StructLayout({"columns": range(MAX_TILES + 1), "lines": LINES, "border": 24})
"""Columns of tiles and lines of a picture, at least one; and the colour of what was never painted, as in `SHOWN`."""
SHOWN = data.StructLayout({"data": 24, "first": 1, "last": 1})
"""A pixel: green in the lowest byte, then blue, red (UG934); whether it starts a picture, whether it ends a line."""
QUEUE_WORDS = 512
"""Pairs of pixels that wait for the display."""


class LineReader(wiring.Component):
    """Reads a picture of the canvas for each request; equal to `golden_model.painting.line_reader`.

    A burst is a tile's part of a line. Only as much is asked for as the queue holds, so a display that stops makes no
    memory wait. Each row of tiles is held while it is read, and stays held from one to the next until the picture ends:
    the painter changes none of its tiles meanwhile, nor, of stabilised video, the page. What could not be read has the
    border's colour, and so has the rest of a picture that is stopped: it always ends where it should.

    One pixel per clock, as long as memory gives a word in at least every second clock; the first comes
    ``latency_cycles`` after the request where nothing waits. The next picture is read when the last one is shown. A
    reset forgets the picture.
    """

    i: In(stream.Signature(PICTURE))
    """Pictures to be shown."""
    i_page: In(52)
    """Where the canvas begins; constant while it is held, as `hdl.painting.painter.Painter.o_page`."""
    i_held: In(1)
    """What is held stays as it is."""
    i_stop: In(1)
    """Read no more, and hold nothing."""
    i_words: In(stream.Signature(READ_WORD))
    """What was asked for, in this order."""
    o_bursts: Out(stream.Signature(BURST_PART))
    """What to read; withdrawn by a stop."""
    o: Out(stream.Signature(SHOWN))
    o_hold: Out(HOLD)
    o_failed: Out(1)
    """A word could not be read."""
    o_idle: Out(1)
    """Nothing is held, and no word is under way."""

    latency_cycles = 6

    def elaborate(self, platform: object) -> Module:
        """Ask for bursts in the order of lines, and show their words."""
        m = Module()
        m.submodules.words = words = fifo.SyncFIFOBuffered(width=8 * WORD_BYTES + 1, depth=QUEUE_WORDS)
        # Words that were asked for, and have not come; and have not been shown.
        owed, unshown = Signal(range(QUEUE_WORDS + 1)), Signal(range(QUEUE_WORDS + 1))
        asked = Mux(self.o_bursts.valid & self.o_bursts.ready, BURST_WORDS, 0)
        comes = self.i_words.valid & self.i_words.ready
        picture, is_cut, begins = view_signal(PICTURE, name="picture"), Signal(), self.i.valid & self.i.ready
        m.d.comb += [
            self.i_words.ready.eq(owed.any()),
            words.w_en.eq(comes),
            words.w_data.eq(self.i_words.payload),
            self.o_failed.eq(comes & self.i_words.payload.failed),
            self.o_bursts.payload.last.eq(BURST_WORDS - 1),
        ]
        m.d.sync += [owed.eq(owed + asked - comes), unshown.eq(unshown + asked - (words.r_en & words.r_rdy))]
        with m.If(begins):
            m.d.sync += picture.eq(self.i.payload)
        is_shown = self._show(m, picture, begins, words, is_cut & ~unshown.any())
        has_room = unshown <= QUEUE_WORDS - BURST_WORDS
        self._ask(m, picture, is_cut, is_shown=is_shown, owes=owed.any(), has_room=has_room)
        return m

    def _ask(
        self, m: Module, picture: data.View, is_cut: Signal, *, is_shown: Value, owes: Value, has_room: Value
    ) -> None:
        """Hold row after row of tiles, and ask for its lines."""
        hold, bursts = self.o_hold, self.o_bursts
        line, column, above = Signal(LINES), Signal(range(MAX_TILES)), Signal(range(MAX_TILES**2))
        line_ends = column == delayed(m, picture.columns - 1, 1)[: len(column)]
        is_last = line == delayed(m, picture.lines - 1, 1)[: len(line)]
        m.d.comb += bursts.payload.burst.eq(Cat(line[: (TILE_PX - 1).bit_length()], self.i_page + above + column))
        with m.FSM(name="memory") as memory:
            with m.State("IDLE"):
                m.d.comb += self.i.ready.eq(~self.i_stop)
                m.d.sync += [each.eq(0) for each in (line, column, above, hold.row, is_cut)]
                with m.If(self.i.valid & self.i.ready):
                    m.next = "HOLD"
            with m.State("HOLD"):
                m.d.sync += is_cut.eq(self.i_stop)
                with m.If(self.i_stop):
                    m.next = "END"
                with m.Elif(self.i_held):
                    m.next = "ASK"
            with m.State("ASK"):
                m.d.comb += bursts.valid.eq(has_room & ~self.i_stop)
                m.d.sync += is_cut.eq(self.i_stop)
                with m.If(self.i_stop):
                    m.next = "ANSWERS"
                with m.Elif(bursts.valid & bursts.ready):
                    m.d.sync += [column.eq(Mux(line_ends, 0, column + 1)), line.eq(line + line_ends)]
                    with m.If(line_ends & (is_last | line[: (TILE_PX - 1).bit_length()].all())):
                        m.next = "ANSWERS"
            with m.State("ANSWERS"), m.If(~owes):
                m.d.sync += [hold.row.eq(hold.row + 1), above.eq(above + picture.columns)]
                m.next = "HOLD"
                with m.If(is_cut | (line == picture.lines)):
                    m.next = "END"
            with m.State("END"), m.If(is_shown):
                m.next = "IDLE"
        m.d.comb += self.o_idle.eq(memory.ongoing("IDLE") | memory.ongoing("END"))
        m.d.comb += hold.valid.eq(~self.o_idle)

    def _show(
        self, m: Module, picture: data.View, begins: Value, words: fifo.SyncFIFOBuffered, is_left_out: Value
    ) -> Value:
        """Show the pixels of the words, or of what is left out; whether all of the picture has been shown."""
        column, y, runs, is_first = Signal(range(MAX_TILES * TILE_PX)), Signal(LINES), Signal(), Signal()
        last_column, last_y = delayed(m, picture.columns - 1, 1), delayed(m, picture.lines - 1, 1)
        low = (TILE_PX - 1).bit_length()
        ends_line = column[:low].all() & (column[low:] == last_column)
        loads = runs & (words.r_rdy | is_left_out) & (~self.o.valid | self.o.ready)
        blue, green, red, weight = (
            words.r_data.word_select(column[0], 8 * PIXEL_BYTES)[n : n + 8] for n in range(0, 32, 8)
        )
        is_painted = words.r_rdy & ~words.r_data[-1] & weight.any()
        m.d.comb += words.r_en.eq(loads & column[0])
        m.d.sync += self.o.valid.eq(loads | (self.o.valid & ~self.o.ready))
        with m.If(begins):
            m.d.sync += [runs.eq(1), is_first.eq(1), column.eq(0), y.eq(0)]
        with m.Elif(loads):
            m.d.sync += [column.eq(Mux(ends_line, 0, column + 1)), y.eq(y + ends_line), is_first.eq(0)]
            m.d.sync += runs.eq(~(ends_line & (y == last_y)))
            m.d.sync += self.o.payload.data.eq(Mux(is_painted, Cat(green, blue, red), picture.border))
            m.d.sync += [self.o.payload.first.eq(is_first), self.o.payload.last.eq(ends_line)]
        return ~runs


def add_reader(m: Module, pictures: wiring.PureInterface, shown: wiring.PureInterface) -> LineReader:
    """Add a reader, whose ports to memory (`AXI_READ`) and to a display are ports of the component that ``m`` makes."""
    m.submodules.reader, m.submodules.bursts = reader, bursts = LineReader(), BurstReader()
    wiring.connect(m, reader.o_bursts, bursts.i)
    wiring.connect(m, bursts.o, reader.i_words)
    wiring.connect(m, bursts.bus, wiring.flipped(pictures))
    wiring.connect(m, reader.o, wiring.flipped(shown))
    return reader
