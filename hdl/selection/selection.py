"""Selection of a level's features: the best of each cell, or all in raster order.

Both blocks have the same streams and the method ``connect_hold``, so that a level uses either in the same way.
"""

from amaranth import Cat, Module, Signal, Value
from amaranth.lib import data, fifo, stream, wiring
from amaranth.lib.wiring import In, Out

from golden_model.config import check_range
from golden_model.feature.ilbp import DescriptorPattern
from hdl.feature.extractor import feature_beat, feature_or_end
from hdl.lib.component import Component
from hdl.lib.delay import delayed
from hdl.selection.cell_ranking import MAX_CELL_LOG2, MAX_PER_CELL, MIN_CELL_LOG2, CellRanking
from hdl.selection.level_scan import LevelScan
from hdl.selection.row_buffer import CellRows


class CellSelection(Component):
    """The best features of each cell of one level, cell row by cell row.

    Features are ranked as they arrive. At its end a cell row is sent in order while the next one is filled.

    Parameters
    ----------
    pattern : DescriptorPattern
    width_px : int
        Largest width of the level.
    spacing_cycles : int
        Smallest distance of two features in clocks.
    """

    i: data.View
    """`hdl.feature.extractor.feature_beat`."""
    i_cell_log2: In(range(MAX_CELL_LOG2 + 1))
    """log2 of the cell's side, 5 to 8."""
    i_per_cell: In(range(MAX_PER_CELL + 1))
    """1 to 8."""
    i_reserve: In(1)
    """The pixel that will end a cell row has been admitted and can no longer be stopped."""
    o_busy: Out(1)
    """A cell row is about to end, or has not left yet: another ``i_reserve`` must wait."""
    o_added: Out(1)
    """The frame has one more feature."""
    o: stream.Interface
    """Stream of `hdl.feature.extractor.feature_or_end`: cell by cell, within a cell by falling response, equal
    responses in raster order; then the end of the row."""

    latency_cycles = CellRanking.latency_cycles + CellRows.latency_cycles
    """From the end of a cell row to its first feature at ``o``, if that is in the first cell; each empty cell before it
    adds one clock."""

    def __init__(self, *, pattern: DescriptorPattern, width_px: int, spacing_cycles: int = 2) -> None:
        check_range("width_px", width_px, 1)
        self.pattern = pattern
        self.spacing_cycles = spacing_cycles
        self.cells = -(-width_px >> MIN_CELL_LOG2)
        super().__init__(i=In(feature_beat(pattern)), o=Out(stream.Signature(feature_or_end(pattern))))

    def connect_hold(self, m: Module, settings: data.View, scan: LevelScan) -> Value:
        """Connect the settings and the scan in the level's module; return whether pixels must wait.

        They wait near the end of a cell row while the row before it has not left: the warning of the scan comes early
        enough for the pixels that have been admitted already.
        """
        hold = Signal()
        m.d.comb += [
            self.i_cell_log2.eq(settings.cell_log2),
            self.i_per_cell.eq(settings.per_cell),
            self.i_reserve.eq(scan.o.valid & scan.o.ends_row),
        ]
        # Registered, to keep the path to admission short; the warning allows for it.
        m.d.sync += hold.eq(self.o_busy & scan.o_row_closes)
        return hold

    def elaborate(self, platform: object) -> Module:
        """Ranking, then storage; the end of a row waits until its last feature has been ranked."""
        m = Module()
        m.submodules.ranking = ranking = CellRanking(
            pattern=self.pattern, cells=self.cells, spacing_cycles=self.spacing_cycles
        )
        m.submodules.rows = rows = CellRows(pattern=self.pattern, cells=self.cells)
        ends_row, ends_level = delayed(
            m, Cat(self.i.ends_row, self.i.ends_level), ranking.latency_cycles, reset_less=False
        )
        m.d.comb += [
            ranking.i.eq(self.i),
            ranking.i_cell_log2.eq(self.i_cell_log2),
            ranking.i_per_cell.eq(self.i_per_cell),
            ranking.i_clear.eq(ends_row),
            rows.i_write.eq(ranking.o_kept),
            rows.i_cell.eq(ranking.o_cell),
            rows.i_slot.eq(ranking.o_slot),
            rows.i_feature.eq(ranking.o_feature),
            rows.i_order.eq(ranking.o_order),
            rows.i_close.eq(ends_row),
            rows.i_touched.eq(ranking.o_touched),
            rows.i_ends_level.eq(ends_level),
            self.o_added.eq(ranking.o_kept & ranking.o_added),
        ]
        wiring.connect(m, wiring.flipped(self.o), rows.o)
        # Reserved at admission, not at the end of the row: pixels in the pipeline can no longer be stopped.
        with m.If(self.i_reserve):
            m.d.sync += self.o_busy.eq(1)
        with m.Elif(rows.o_drained):
            m.d.sync += self.o_busy.eq(0)
        return m


class RasterSelection(Component):
    """Every feature of the level in raster order.

    Parameters
    ----------
    pattern : DescriptorPattern
    depth : int
        Length of the queue in features.
    in_flight : int
        Features that may still arrive after admission has stopped.
    """

    i: data.View
    """`hdl.feature.extractor.feature_beat`."""
    o_busy: Out(1)
    """No pixel may be admitted."""
    o_added: Out(1)
    """The frame has one more feature."""
    o: stream.Interface
    """Stream of `hdl.feature.extractor.feature_or_end`. The end of the level is the end of its only row."""

    latency_cycles = 2
    """From a feature at ``i`` to the same feature at ``o``."""

    def __init__(self, *, pattern: DescriptorPattern, depth: int, in_flight: int) -> None:
        check_range("in_flight", in_flight, 0, depth - 1)
        self.depth = depth
        self.in_flight = in_flight
        super().__init__(i=In(feature_beat(pattern)), o=Out(stream.Signature(feature_or_end(pattern))))

    def connect_hold(self, m: Module, settings: data.View, scan: LevelScan) -> Value:
        """Return whether pixels must wait: while the queue is nearly full. Settings and scan are not needed."""
        hold: Value = self.o_busy
        return hold

    def elaborate(self, platform: object) -> Module:
        """A queue. The end of the level enters one clock after its last beat, when no feature can arrive."""
        m = Module()
        m.submodules.queue = queue = fifo.SyncFIFOBuffered(width=len(self.o.p.as_value()), depth=self.depth)
        ends_level = delayed(m, self.i.ends_level, 1, reset_less=False)
        entry = Signal.like(self.o.p)
        m.d.comb += [
            entry.feature.eq(self.i.feature),
            entry.ends_row.eq(ends_level),
            entry.ends_level.eq(ends_level),
            self.o_added.eq(self.i.present),
            queue.w_data.eq(entry),
            queue.w_en.eq(self.i.present | ends_level),
        ]
        wiring.connect(m, queue.r_stream, wiring.flipped(self.o))
        m.d.sync += self.o_busy.eq(queue.r_level >= self.depth - self.in_flight)
        return m
