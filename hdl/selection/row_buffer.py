"""Buffer of two cell rows: one is filled while the other is read out in order."""

from amaranth import Cat, Module, Mux, Signal, Value
from amaranth.lib import data, memory, stream
from amaranth.lib.wiring import In, Out

from golden_model.feature.ilbp import DescriptorPattern
from hdl.feature.extractor import feature_layout, feature_or_end
from hdl.lib.component import Component
from hdl.lib.line_memory import LineMemory
from hdl.selection.cell_ranking import MAX_PER_CELL, ORDER


class CellRows(Component):
    """Features by cell and slot, and the order of each cell's slots, in two banks.

    Parameters
    ----------
    pattern : DescriptorPattern
    cells : int
        Largest number of cells in a row.
    """

    i_write: In(1)
    """Writes ``i_feature`` into slot ``i_slot`` of cell ``i_cell``, and ``i_order`` for the cell."""
    i_cell: Signal
    i_slot: In(range(MAX_PER_CELL))
    i_feature: data.View
    i_order: In(ORDER)
    i_close: In(1)
    """With or after the row's last write: the banks change roles. Allowed only when the closed row has been read
    out."""
    i_touched: Signal
    """Valid with ``i_close``: the cells of the row that were written."""
    i_ends_level: In(1)
    """Valid with ``i_close``: it is the last row of the level."""
    o_drained: Out(1)
    """The closed row has been read out; high for one clock."""
    o: stream.Interface
    """Stream of `hdl.feature.extractor.feature_or_end`."""

    latency_cycles = 4
    """From ``i_close`` to the first feature of the first cell; each empty cell before it adds one clock."""

    def __init__(self, *, pattern: DescriptorPattern, cells: int) -> None:
        self.cells = cells
        self._feature = feature_layout(pattern)
        self._request = data.StructLayout(
            {"cell": range(cells), "slot": range(MAX_PER_CELL), "ends_row": 1, "ends_level": 1}
        )
        super().__init__(
            i_cell=In(range(cells)),
            i_feature=In(self._feature),
            i_touched=In(cells),
            o=Out(stream.Signature(feature_or_end(pattern))),
        )

    def elaborate(self, platform: object) -> Module:
        """Both memories, the choice of the bank to fill, and the two stages that read the other bank."""
        m = Module()
        # Two banks; a power of two for each, so that the bank is the highest address bit.
        depth = 2 << len(self.i_cell)
        # Few words of many bits: LUT memory.
        attributes = {"ram_style": "distributed"}
        orders: memory.Memory
        m.submodules.orders = orders = memory.Memory(shape=ORDER, depth=depth, init=[], attrs=attributes)
        m.submodules.features = features = LineMemory(shape=self._feature, depth=depth * MAX_PER_CELL, loads=True)
        filling = Signal()
        with m.If(self.i_close):
            m.d.sync += filling.eq(~filling)
        order_write = orders.write_port()
        m.d.comb += [
            order_write.en.eq(self.i_write),
            order_write.addr.eq(Cat(self.i_cell, filling)),
            order_write.data.eq(self.i_order),
            features.i_write.eq(self.i_write),
            features.i_write_address.eq(Cat(self.i_slot, self.i_cell, filling)),
            features.i_word.eq(self.i_feature),
        ]

        requests = stream.Signature(self._request).create()
        order_read = orders.read_port()
        self._walk(m, order_read, ~filling, requests)
        self._fetch(m, features, ~filling, requests)
        m.d.comb += self.o_drained.eq(requests.valid & requests.ready & requests.p.ends_row)
        return m

    def _walk(self, m: Module, order: memory.ReadPort, bank: Value, requests: stream.Interface) -> None:
        """Request the feature of every taken place of every cell, then the end of the row."""
        # Set when a row closes, before it is used.
        cell = Signal.like(self.i_cell, reset_less=True)
        place = Signal(range(MAX_PER_CELL))
        next_cell = Signal()
        # Shifted by one for every cell: the lowest bit belongs to the current cell.
        touched = Signal.like(self.i_touched, reset_less=True)
        ends_level = Signal(reset_less=True)
        # Places are taken from the front, so the list of a cell ends where the next place is free.
        followed = Cat(Cat(later.taken for later in order.data)[1:], 0).bit_select(place, 1)
        with m.If(self.i_close):
            m.d.sync += [touched.eq(self.i_touched), ends_level.eq(self.i_ends_level), cell.eq(0)]
        with m.Elif(next_cell):
            m.d.sync += [touched.eq(touched >> 1), cell.eq(cell + 1)]
        m.d.comb += [
            order.addr.eq(Cat(cell, bank)),
            requests.p.cell.eq(cell),
            requests.p.slot.eq(order.data[place].slot),
            requests.p.ends_level.eq(ends_level),
        ]
        last_cell = cell == self.cells - 1
        with m.FSM():
            with m.State("Fill"), m.If(self.i_close):
                m.next = "Read-Order"
            with m.State("Read-Order"):
                m.d.comb += order.en.eq(1)
                with m.If(touched[0]):
                    m.next = "Request-Features"
                with m.Else():
                    m.d.comb += next_cell.eq(1)
                    with m.If(last_cell):
                        m.next = "Request-End"
            with m.State("Request-Features"):
                m.d.comb += requests.valid.eq(1)
                with m.If(requests.ready):
                    m.d.sync += place.eq(Mux(followed, place + 1, 0))
                    with m.If(~followed):
                        m.d.comb += next_cell.eq(1)
                        m.next = "Read-Order"
                        with m.If(last_cell):
                            m.next = "Request-End"
            with m.State("Request-End"):
                m.d.comb += [requests.valid.eq(1), requests.p.ends_row.eq(1)]
                with m.If(requests.ready):
                    m.next = "Fill"

    def _fetch(self, m: Module, features: LineMemory, bank: Value, requests: stream.Interface) -> None:
        """Read what is requested, in two stages: the memory, and its output register.

        A stage takes the next feature only once it is empty, not in the clock in which it becomes empty. That costs no
        throughput, because a feature has several words, and keeps ``ready`` out of long combinational paths.
        """
        # The output register of the memory is that of the output: the memory alone is too slow to be followed by wires.
        fetched = Signal()
        mark = Signal.like(requests.p, reset_less=True)
        ends_row = Signal(reset_less=True)
        ends_level = Signal(reset_less=True)
        advance = fetched & ~self.o.valid
        m.d.comb += [
            requests.ready.eq(~fetched),
            features.i_read.eq(requests.valid & requests.ready),
            features.i_read_address.eq(Cat(requests.p.slot, requests.p.cell, bank)),
            features.i_load.eq(advance),
            self.o.p.feature.eq(features.o_word),
            self.o.p.ends_row.eq(ends_row),
            self.o.p.ends_level.eq(ends_level),
        ]
        with m.If(features.i_read):
            m.d.sync += [fetched.eq(1), mark.eq(requests.p)]
        with m.If(advance):
            m.d.sync += [
                fetched.eq(0),
                self.o.valid.eq(1),
                ends_row.eq(mark.ends_row),
                ends_level.eq(mark.ends_row & mark.ends_level),
            ]
        with m.Elif(self.o.ready):
            m.d.sync += self.o.valid.eq(0)
