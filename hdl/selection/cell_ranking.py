"""Ranks the features of each cell in a cell row as they arrive."""

from amaranth import Array, Cat, Const, Module, Mux, Signal, Value
from amaranth.lib import data, memory, wiring
from amaranth.lib.wiring import In, Out

from golden_model.feature.ilbp import DescriptorPattern
from golden_model.formats import RESPONSE_CODE
from hdl.feature.extractor import feature_beat, feature_layout
from hdl.lib.component import Component
from hdl.lib.delay import delayed, port_register
from hdl.lib.views import view_signal
from hdl.settings import SETTINGS

MAX_PER_CELL = SETTINGS["per_cell"].values[-1]
MIN_CELL_LOG2, *_, MAX_CELL_LOG2 = SETTINGS["cell_log2"].values


RANK = data.StructLayout({"response": RESPONSE_CODE.bits, "slot": range(MAX_PER_CELL)})
"""A place in a cell: the response of its feature, 0 where it is free, and the slot that holds the feature."""
PLACE = data.StructLayout({"taken": 1, "slot": range(MAX_PER_CELL)})
"""A rank without its response: what is still needed when the row is complete."""
RANKING = data.ArrayLayout(RANK, MAX_PER_CELL)
"""The places of a cell by falling response, equal responses in raster order, free places last."""
ORDER = data.ArrayLayout(PLACE, MAX_PER_CELL)
_EMPTY = RANKING.const([{"response": 0, "slot": slot} for slot in range(MAX_PER_CELL)])


class Insertion(wiring.Component):
    """Inserts a feature into a ranking, behind every response that is not smaller.

    The comparisons take one clock; the results appear in the next.

    Parameters
    ----------
    spacing_cycles : int
        Smallest distance of two features in clocks. The inputs of a feature must stay that long, at most two clocks.
    """

    i_valid: In(1)
    """The inputs belong to a feature."""
    i_ranking: In(RANKING)
    """The ranking of its cell."""
    i_empty: In(1)
    """Every place is free, regardless of ``i_ranking``."""
    i_response: In(RESPONSE_CODE.bits)
    """Response of the new feature, not 0."""
    i_last_place: In(range(MAX_PER_CELL))
    """Index of the last place in use: features kept per cell, minus 1."""
    o_kept: Out(1)
    """The new feature has a place."""
    o_slot: Out(range(MAX_PER_CELL))
    """The slot it takes: that of the last place, which is free or whose feature is dropped."""
    o_added: Out(1)
    """Valid with ``o_kept``: that place was free."""
    o_ranking: Out(RANKING)
    """The ranking with the new feature."""
    o_order: Out(ORDER)
    """The same ranking without responses."""

    latency_cycles = 1

    def __init__(self, *, spacing_cycles: int = 2) -> None:
        self.spacing_cycles = spacing_cycles
        super().__init__()

    def elaborate(self, platform: object) -> Module:
        """Move every place with a smaller response down by one: they are the last ones, since responses fall."""
        m = Module()
        newcomer = view_signal(RANK)
        ranking = view_signal(RANKING)
        ranks = [self.i_ranking[place] for place in range(MAX_PER_CELL)]
        taken = Signal(MAX_PER_CELL, reset_less=True)
        beaten = Signal(MAX_PER_CELL, reset_less=True)
        last_slot = Array(rank.slot for rank in ranks)[self.i_last_place]
        wins = Cat(rank.response < self.i_response for rank in ranks) | self.i_empty.replicate(MAX_PER_CELL)
        in_use = Cat(self.i_last_place >= place for place in range(MAX_PER_CELL))
        slot = port_register(m, self.o_slot)
        with m.If(self.i_valid):
            m.d.sync += [
                slot.eq(Mux(self.i_empty, self.i_last_place, last_slot)),
                taken.eq(Cat(rank.response.any() for rank in ranks) & ~self.i_empty.replicate(MAX_PER_CELL)),
                beaten.eq(wins & in_use),
            ]
        # At the shortest spacing the inputs are gone when the comparisons are done.
        kept_cycles = int(self.spacing_cycles == 1)
        m.d.comb += [
            ranking.eq(delayed(m, Mux(self.i_empty, _EMPTY, self.i_ranking), kept_cycles)),
            newcomer.response.eq(delayed(m, self.i_response, kept_cycles)),
            newcomer.slot.eq(self.o_slot),
            self.o_kept.eq(beaten.any()),
            self.o_added.eq(~taken.bit_select(self.i_last_place, 1)),
        ]
        # A beaten place takes the entry above it if that one is beaten too, else the new feature.
        above = newcomer
        above_taken: Value = Const(1)
        above_beaten: Value = Const(0)
        for place in range(MAX_PER_CELL):
            rank = ranking[place]
            m.d.comb += [
                self.o_ranking[place].eq(
                    Mux(beaten[place], Mux(above_beaten, above.as_value(), newcomer.as_value()), rank.as_value())
                ),
                self.o_order[place].slot.eq(self.o_ranking[place].slot),
                self.o_order[place].taken.eq(above_taken & in_use[place]),
            ]
            above, above_taken, above_beaten = rank, taken[place], beaten[place]
        return m


class CellRanking(Component):
    """Ranks the features of the cell row that is being filled.

    Parameters
    ----------
    pattern : DescriptorPattern
    cells : int
        Largest number of cells in a row.
    spacing_cycles : int
        Smallest distance of two features in clocks.
    """

    i: data.View
    """`hdl.feature.extractor.feature_beat`."""
    i_cell_log2: In(range(MAX_CELL_LOG2 + 1))
    """log2 of the cell's side, 5 to 8."""
    i_per_cell: In(range(MAX_PER_CELL + 1))
    """1 to 8."""
    i_clear: In(1)
    """Empties every ranking."""
    o_kept: Out(1)
    """A feature has been given a place; ``latency_cycles`` after its beat."""
    o_cell: Signal
    """Cell of the feature."""
    o_slot: Out(range(MAX_PER_CELL))
    """Slot of the feature in the cell."""
    o_feature: data.View
    """The feature."""
    o_order: Out(ORDER)
    """The current places of its cell."""
    o_added: Out(1)
    """Valid with ``o_kept``: no other feature has lost its place."""
    o_touched: Signal
    """The cells that have a feature."""

    latency_cycles = 2 + Insertion.latency_cycles

    def __init__(self, *, pattern: DescriptorPattern, cells: int, spacing_cycles: int = 2) -> None:
        self.cells = cells
        self.spacing_cycles = spacing_cycles
        super().__init__(
            i=In(feature_beat(pattern)),
            o_cell=Out(range(cells)),
            o_feature=Out(feature_layout(pattern)),
            o_touched=Out(cells),
        )

    def elaborate(self, platform: object) -> Module:
        """Locate the cell, read its ranking, compare, insert and write back: one clock each.

        When two features of one cell are only two clocks apart, the second would read the ranking before the first is
        written. It takes the ranking from the insertion instead, one clock later when they are one clock apart.
        """
        m = Module()
        # Few words of many bits fit LUT memory better than block RAM. Old rankings need not be cleared: `o_touched`
        # tells which rankings belong to this row.
        rankings: memory.Memory = memory.Memory(
            shape=RANKING, depth=self.cells, init=[], attrs={"ram_style": "distributed"}
        )
        m.submodules.rankings = rankings
        m.submodules.insertion = insertion = Insertion(spacing_cycles=self.spacing_cycles)
        read = rankings.read_port(domain="comb")
        write = rankings.write_port()
        cell = Signal.like(self.o_cell, reset_less=True)
        feature = Signal.like(self.i.feature, reset_less=True)
        ranking = view_signal(RANKING, reset_less=True)
        touched = Signal(reset_less=True)
        # What is compared is also what leaves, unless the next feature may already be compared then.
        current_cell, current_feature = self.o_cell, self.o_feature
        if self.spacing_cycles == 1:
            current_cell = Signal.like(self.o_cell)
            current_feature = Signal.like(self.o_feature)
            m.d.comb += self.o_cell.eq(delayed(m, current_cell, 1))
            m.d.comb += self.o_feature.eq(delayed(m, current_feature, 1))
        compared_cell = port_register(m, current_cell)
        compared_feature = port_register(m, current_feature)
        located = delayed(m, self.i.present, 1, reset_less=False)
        compared = delayed(m, located, 1, reset_less=False)
        arrived = delayed(m, compared, insertion.latency_cycles, reset_less=False)
        located_cell = Signal.like(cell)
        is_in_last_cell = Signal(reset_less=True)
        # A shift by 0 to 3: cells have 32 to 256 px.
        m.d.comb += located_cell.eq(self.i.x[MIN_CELL_LOG2:] >> (self.i_cell_log2 - MIN_CELL_LOG2)[:2])
        with m.If(self.i.present):
            m.d.sync += [
                cell.eq(located_cell),
                feature.eq(self.i.feature),
                is_in_last_cell.eq(compared & (located_cell == current_cell)),
            ]
        with m.If(located):
            m.d.sync += [
                compared_cell.eq(cell),
                compared_feature.eq(feature),
                ranking.eq(Mux(is_in_last_cell, insertion.o_ranking.as_value(), read.data.as_value())),
                touched.eq(self.o_touched.bit_select(cell, 1) & ~self.i_clear),
            ]
        with m.If(self.i_clear):
            m.d.sync += self.o_touched.eq(0)
        with m.Elif(compared):
            m.d.sync += self.o_touched.eq(self.o_touched | (1 << current_cell))
        newest, is_empty = ranking.as_value(), ~touched
        if self.spacing_cycles == 1:
            # In the same cell as the feature of the clock before, which is being inserted.
            follows = delayed(m, delayed(m, located & (located_cell == cell), 1), 1)
            newest, is_empty = Mux(follows, insertion.o_ranking.as_value(), newest), ~(touched | follows)
        m.d.comb += [
            read.addr.eq(cell),
            insertion.i_valid.eq(compared),
            insertion.i_ranking.eq(newest),
            insertion.i_empty.eq(is_empty),
            insertion.i_response.eq(current_feature.response),
            insertion.i_last_place.eq(delayed(m, (self.i_per_cell - 1)[:3], 1)),
            write.addr.eq(self.o_cell),
            write.data.eq(insertion.o_ranking),
            # If the new feature has no place, the same ranking is written again.
            write.en.eq(arrived),
            self.o_kept.eq(arrived & insertion.o_kept),
            self.o_slot.eq(insertion.o_slot),
            self.o_order.eq(insertion.o_order),
            self.o_added.eq(insertion.o_added),
        ]
        return m
