"""Tiles of the canvas: the old pixels of each out of memory, its new ones into it."""

from amaranth import Cat, Module, Mux, Signal, Value
from amaranth.lib import data, fifo, stream, wiring
from amaranth.lib.wiring import In, Out

from golden_model.painting.tiles import MAX_TILES, TILE_PX
from golden_model.records import WORD_BYTES
from hdl.axi.axi_read import AXI_READ, BurstReader
from hdl.axi.axi_write import AXI_WRITE, BURST_WORDS, PAGE_BURSTS_LOG2, BurstWriter
from hdl.lib.delay import delayed
from hdl.lib.multiplier import Multiplier, multiply
from hdl.lib.views import view_signal
from hdl.painting.sampling import PIXEL, smaller
from hdl.painting.tiles import TILE
from hdl.painting.windows import PAINTED_TILE, PLAN

TILES = 4
"""Tiles under way: two windows, and one on either side of them."""
TILE_BURSTS = 1 << PAGE_BURSTS_LOG2
"""A tile is a page: a burst is a row of it."""
OLD_WORDS, NEW_WORDS = 512, 64
"""A whole tile waits to be painted; what is painted waits for the memory a little."""
NUMBER_CYCLES = Multiplier.latency_cycles + 1
PIPELINE_WORDS = 32
"""Pairs of pixels between the old and the new ones, at most."""
HOLD = data.StructLayout({"valid": 1, "row": range(MAX_TILES)})
"""A row of tiles that is being read."""
HOLDS = data.ArrayLayout(HOLD, 2)
"""Those of a host, and of the reader in lines."""


class CanvasPort(wiring.Component):
    """Gives the old pixels of tiles, and writes the new ones in the same order, 1,024 for each tile.

    A tile is read while others are painted; one that was never painted is not read, its old pixels are 0. Words that
    could not be read are not written either, so that nothing is painted over them. Where a word could not be read, or a
    burst not written, the tile's smallest weight is 0, so that it may be painted again; and a tile of which the first
    painting failed counts as never painted.
    """

    i: In(stream.Signature(PLAN))
    """Tiles that will be painted, in this order."""
    i_replace: In(1)
    """The old pixels do not matter: they are 0. Constant while a frame is painted, as the next two."""
    i_page: In(52)
    """Where the canvas begins, in pages of 4 KiB; a tile is a page, rows of tiles follow each other."""
    i_columns: In(range(MAX_TILES + 1))
    """Columns of the canvas, in tiles."""
    i_holds: In(HOLDS)
    """No tile of these rows is begun: it waits, and those behind it with it."""
    reads: Out(AXI_READ)
    writes: Out(AXI_WRITE)
    o: Out(stream.Signature(PIXEL))
    """Old pixels, row by row."""
    i_new: In(stream.Signature(PIXEL))
    """New pixels."""
    o_held: Out(HOLDS.length)
    """Of each row at ``i_holds``, whether no tile of it is under way; in the same clock."""
    o_painted: Out(PAINTED_TILE)
    o_error: Out(1)
    """Memory answers with an error."""
    o_idle: Out(1)
    """Every tile is in memory."""

    def elaborate(self, platform: object) -> Module:
        """Three queues of tiles: to be read, to be given, to be written."""
        m = Module()
        m.submodules.reader, m.submodules.bursts = reader, bursts = BurstReader(), BurstWriter()
        wiring.connect(m, reader.bus, wiring.flipped(self.reads))
        wiring.connect(m, bursts.bus, wiring.flipped(self.writes))
        m.submodules.failures = failures = fifo.SyncFIFO(width=1, depth=PIPELINE_WORDS)
        tile, was_painted, number = self._number(m)
        is_read = was_painted & ~self.i_replace
        entering = Signal(NUMBER_CYCLES)
        m.d.sync += entering.eq(Cat(self.i.valid & self.i.ready, entering))
        to_read, to_give, to_write = (
            self._queue(m, name, entry, entering[-1])
            for name, entry in (
                ("to_read", Cat(is_read, number)),
                ("to_give", is_read),
                ("to_write", Cat(tile, was_painted, number)),
            )
        )
        m.d.comb += [
            # The others are never longer than this one.
            self.i.ready.eq(to_write.w_rdy & ~entering.any()),
            self.o_error.eq(reader.o_error | bursts.o_error),
            self.o_idle.eq(~to_write.r_rdy & ~entering.any()),
        ]
        self._give(m, to_give, failures, self._read(m, reader, to_read))
        self._write(m, bursts, to_write, *self._collect(m, failures))
        return m

    def _number(self, m: Module) -> tuple[Value, Value, Value]:
        """The tile at the input, whether it was painted, and its place in the canvas; `NUMBER_CYCLES` later."""
        visited = self.i.payload
        above = multiply(m, "above", visited.tile.row, self.i_columns)
        column = delayed(m, visited.tile.column, Multiplier.latency_cycles)
        tile, was_painted = (delayed(m, Value.cast(each), NUMBER_CYCLES) for each in (visited.tile, visited.painted))
        return tile, was_painted, delayed(m, (above + column)[: len(tile)], 1)

    @staticmethod
    def _queue(m: Module, name: str, entry: Value, arrives: Value) -> fifo.SyncFIFO:
        m.submodules[name] = queue = fifo.SyncFIFO(width=len(entry), depth=TILES)
        m.d.comb += [queue.w_data.eq(entry), queue.w_en.eq(arrives)]
        return queue

    def _read(self, m: Module, reader: BurstReader, tiles: fifo.SyncFIFO) -> fifo.SyncFIFOBuffered:
        """Read ahead as far as there is room; returns the words."""
        m.submodules.old = old = fifo.SyncFIFOBuffered(width=8 * WORD_BYTES + 1, depth=OLD_WORDS)
        burst, promised = Signal(range(TILE_BURSTS)), Signal(range(OLD_WORDS + 1))
        is_read, number = tiles.r_data[0], tiles.r_data[1:]
        asks = reader.i.valid & reader.i.ready
        m.d.comb += [
            reader.i.valid.eq(tiles.r_rdy & is_read & (promised <= OLD_WORDS - BURST_WORDS)),
            reader.i.payload.burst.eq(Cat(burst, self.i_page + number)),
            reader.i.payload.last.eq(BURST_WORDS - 1),
            tiles.r_en.eq(~is_read | (asks & (burst == TILE_BURSTS - 1))),
            old.w_en.eq(reader.o.valid),
            old.w_data.eq(reader.o.payload),
            reader.o.ready.eq(1),
        ]
        m.d.sync += [burst.eq(burst + asks), promised.eq(promised + Mux(asks, BURST_WORDS, 0) - (old.r_rdy & old.r_en))]
        return old

    def _give(self, m: Module, tiles: fifo.SyncFIFO, failures: fifo.SyncFIFO, old: fifo.SyncFIFOBuffered) -> None:
        """Give pixels of the words, or zeros, and remember of each word whether it could be read."""
        # A register between, since the words of a block RAM come late in a clock.
        held, is_held = Signal(len(old.r_data), reset_less=True), Signal()
        word, pixel, is_read = Signal(range(TILE_PX * TILE_PX // 2)), Signal(), tiles.r_data
        ends_word = self.o.valid & self.o.ready & pixel
        loads = (~is_held | ends_word) & tiles.r_rdy & (~is_read | old.r_rdy)
        m.d.comb += [
            self.o.valid.eq(is_held & failures.w_rdy),
            self.o.payload.eq(held[:-1].word_select(pixel, PIXEL.size)),
            old.r_en.eq(loads & is_read),
            failures.w_en.eq(ends_word),
            failures.w_data.eq(held[-1]),
            tiles.r_en.eq(loads & word.all()),
        ]
        m.d.sync += [
            pixel.eq(pixel ^ (self.o.valid & self.o.ready)),
            word.eq(word + loads),
            is_held.eq(loads | (is_held & ~ends_word)),
        ]
        with m.If(loads):
            m.d.sync += held.eq(Mux(is_read, old.r_data, 0))

    def _collect(self, m: Module, failures: fifo.SyncFIFO) -> tuple[fifo.SyncFIFOBuffered, Signal]:
        """Join two new pixels in a word; returns the words, and the smallest weight of the tile that ended last."""
        m.submodules.new = new = fifo.SyncFIFOBuffered(width=8 * WORD_BYTES + 1, depth=NEW_WORDS)
        pixel, left = Signal(range(TILE_PX * TILE_PX)), view_signal(PIXEL, name="left", reset_less=True)
        least, tile_least = Signal.like(left.weight), Signal.like(left.weight, reset_less=True)
        right, has_failed = self.i_new.payload, failures.r_data[0]
        ends_word = self.i_new.valid & self.i_new.ready & pixel[0]
        m.d.comb += [
            self.i_new.ready.eq(~pixel[0] | (new.w_rdy & failures.r_rdy)),
            new.w_en.eq(ends_word),
            new.w_data.eq(Cat(left, right, ~has_failed)),
            failures.r_en.eq(ends_word),
        ]
        with m.If(self.i_new.valid & self.i_new.ready):
            m.d.sync += [pixel.eq(pixel + 1), left.eq(right)]
        # A clock later, since these are two comparisons.
        pair, pair_failed = smaller(m, left.weight, right.weight), delayed(m, has_failed, 1)
        begins, ends = delayed(m, pixel[1:] == 0, 1), delayed(m, pixel.all(), 1)
        smallest = Mux(pair_failed, 0, Mux(~begins & (least < pair), least, pair))
        with m.If(delayed(m, ends_word, 1, reset_less=False)):
            m.d.sync += least.eq(smallest)
            with m.If(ends):
                m.d.sync += tile_least.eq(smallest)
        return new, tile_least

    def _write(
        self, m: Module, bursts: BurstWriter, tiles: fifo.SyncFIFO, new: fifo.SyncFIFOBuffered, least: Signal
    ) -> None:
        """Write a burst when its words are there; a tile is painted when the memory has answered all of it."""
        burst, sends, has_failed = Signal(range(TILE_BURSTS)), Signal(), Signal()
        tile_bits = len(Value.cast(self.o_painted.tile))
        tile, was_painted, number = tiles.r_data[:tile_bits], tiles.r_data[tile_bits], tiles.r_data[tile_bits + 1 :]
        begun = sends | burst.any()
        is_at = Cat(self.i_holds[n].row == data.View(TILE, tile).row for n in range(HOLDS.length))
        is_held = (is_at & Cat(self.i_holds[n].valid for n in range(HOLDS.length))).any() & ~begun
        m.d.comb += [
            self.o_held.eq(~(is_at & begun.replicate(HOLDS.length))),
            bursts.i_burst.eq(Cat(burst, self.i_page + number)),
            bursts.i_start.eq(~sends & bursts.o_ready & (new.r_level >= BURST_WORDS) & ~is_held),
            bursts.i.valid.eq(new.r_rdy),
            bursts.i.payload.eq(new.r_data),
            new.r_en.eq(bursts.i.ready),
            self.o_painted.tile.eq(tile),
            self.o_painted.painted.eq(was_painted | ~has_failed),
            # The next tile ends much later: only so many of its words wait.
            self.o_painted.least.eq(Mux(has_failed, 0, least)),
            tiles.r_en.eq(self.o_painted.valid),
        ]
        m.d.sync += has_failed.eq((has_failed | bursts.o_error) & ~self.o_painted.valid)
        with m.If(bursts.i_start):
            m.d.sync += sends.eq(1)
        with m.Elif(sends & Mux(burst.all(), bursts.o_all_answered, bursts.o_sent)):
            m.d.comb += self.o_painted.valid.eq(burst.all())
            m.d.sync += [sends.eq(0), burst.eq(burst + 1)]
