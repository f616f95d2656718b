"""Memories that change roles: what is being read is not written, and it is what was stored."""

from pathlib import Path

import pytest
from amaranth import Array, Cat, Const, Elaboratable, Module, Mux, Signal, Value
from amaranth.hdl import Assert, Assume, Cover

from golden_model.feature.ilbp import DescriptorPattern
from golden_model.records import FRAME_STATUS, WORD_BYTES, Tag
from hdl.matching.feature_banks import READ_CYCLES, FeatureBanks
from hdl.selection.row_buffer import CellRows
from tests.formal.proofs import happened, held, leaves_in_order, prove

PATTERN = DescriptorPattern("one byte", (0, 1), 8, ((1, 0, 0),), smoothed=False, oriented=False)
MAX_FEATURES = 2
RECORD = PATTERN.record
RECORD_WORDS = RECORD.record_bytes // WORD_BYTES
WORD_BITS = 8 * WORD_BYTES
ROW_END = 2
"""Stands for the end of a row where 0 and 1 stand for features."""
MAX_LEAVING = 5
"""A row's two features and its end, and what waits between memory and output."""


def _places(record: object) -> dict[str, tuple[int, int]]:
    """Word and lowest bit of each field."""
    return {field.name: divmod(8 * offset, WORD_BITS) for field, offset in record.offsets()}


class _Banks(Elaboratable):
    """Frames of up to two features, good or bad, with the roles asked for at random; one bit of x stands for a feature.

    One address is read all the time: what it gives may only change with the roles, whatever is being stored.
    """

    def __init__(self) -> None:
        self.banks = FeatureBanks(pattern=PATTERN, max_features=MAX_FEATURES)
        self.valid, self.is_status, self.bit, self.good = (
            Signal(name=f"i_{n}") for n in ("valid", "status", "bit", "good")
        )
        self.address, self.ready = Signal(range(MAX_FEATURES)), Signal()
        roles = self.banks.i_hold_reference, self.banks.i_take_reference
        self.ports = [self.valid, self.is_status, self.bit, self.good, self.address, self.ready, *roles]

    def elaborate(self, platform: object) -> Module:
        m = Module()
        m.submodules.banks = banks = self.banks
        before, running = Signal.like(self.address), Signal()
        m.d.sync += [before.eq(self.address), running.eq(1)]
        with m.If(running):
            m.d.comb += Assume(before == self.address)
        m.d.comb += [banks.i_left_address.eq(self.address), banks.i_right_address.eq(self.address)]
        m.d.comb += banks.o_status.ready.eq(self.ready)
        held(m, Assert, banks.o_status.valid, self.ready, Value.cast(banks.o_status.payload))
        self._frames(m)
        return m

    def _frames(self, m: Module) -> None:
        """Words of records; what was stored last at the address."""
        i = self.banks.i
        word, count, stored, writes = Signal(range(RECORD_WORDS)), Signal(range(MAX_FEATURES + 1)), Signal(), Signal()
        held(m, Assume, self.valid, i.ready, self.is_status, self.bit, self.good)
        m.d.comb += [i.valid.eq(self.valid), Assume(self.is_status | (count < MAX_FEATURES))]
        feature, status = _places(RECORD), _places(FRAME_STATUS)

        def put(place: tuple[int, int], value: Value, bits: int) -> None:
            with m.If(word == place[0]):
                m.d.comb += i.payload.data[place[1] : place[1] + bits].eq(value)

        put((0, 0), Mux(self.is_status, Tag.FRAME_STATUS, Tag.FEATURE), 8)
        with m.If(self.is_status):
            put(status["good"], self.good, 1)
            put(status["features"], count, 16)
        with m.Else():
            put(feature["index"], count, 16)
            put(feature["x"], self.bit, 1)
        kind = Signal()
        with m.If(word > 0):
            m.d.comb += Assume(self.is_status == kind)
        with m.If(self.valid & i.ready):
            m.d.sync += [word.eq(Mux(word == RECORD_WORDS - 1, 0, word + 1)), kind.eq(self.is_status)]
            with m.If(~self.is_status & (word == feature["x"][0]) & (count == self.address)):
                m.d.sync += stored.eq(self.bit)
            with m.If(word == RECORD_WORDS - 1):
                m.d.sync += count.eq(Mux(self.is_status, 0, count + 1))
                m.d.comb += writes.eq(~self.is_status & (count == self.address))
        self._roles(m, stored, writes)

    def _roles(self, m: Module, stored: Signal, writes: Signal) -> None:
        """Reference and current frame, as they follow from the good frames and what was asked."""
        banks, status = self.banks, self.banks.o_status
        bits = {name: Signal(name=f"{name}_bit") for name in ("reference", "current")}
        counts = {name: Signal(range(MAX_FEATURES + 1), name=f"{name}_count") for name in bits}
        has = {name: Signal(name=f"has_{name}") for name in bits}
        age = Signal(range(READ_CYCLES + 2))
        features = status.payload.features
        m.d.sync += age.eq(Mux(age == READ_CYCLES + 1, age, age + 1))
        with m.If(status.valid & status.ready & status.payload.good):
            m.d.sync += age.eq(0)
            with m.If(~has["reference"] | banks.i_take_reference):
                m.d.sync += [bits["reference"].eq(stored), counts["reference"].eq(features), counts["current"].eq(0)]
                m.d.sync += [has["reference"].eq(1), has["current"].eq(0)]
            with m.Else():
                m.d.sync += [bits["current"].eq(stored), counts["current"].eq(features), has["current"].eq(1)]
                with m.If(has["current"] & ~banks.i_hold_reference):
                    m.d.sync += [bits["reference"].eq(bits["current"]), counts["reference"].eq(counts["current"])]

        settled = age == READ_CYCLES + 1
        outputs = {"reference": (banks.o_left, banks.o_left_count), "current": (banks.o_right, banks.o_right_count)}
        for name, (read, count) in outputs.items():
            m.d.comb += Assert(count == counts[name])
            with m.If(settled & (self.address < count)):
                m.d.comb += Assert(read.x[0] == bits[name])
        both = settled & (self.address < counts["reference"]) & (self.address < counts["current"])
        m.d.comb += [
            Cover(both & writes & (self.bit != bits["reference"]) & (self.bit != bits["current"])),
            Cover(both & (bits["reference"] != bits["current"])),
        ]


def test_a_bank_that_is_read_is_not_written(tmp_path: Path) -> None:
    prove(_Banks(), tmp_path)


class _Rows(Elaboratable):
    """Rows of two cells with a feature each, or none, in one of two slots; one bit of x stands for a feature.

    While a row leaves, the next one is written; it is closed as soon as the one before has been read.
    """

    def __init__(self) -> None:
        self.rows = CellRows(pattern=PATTERN, cells=2)
        self.write, self.cell, self.slot, self.bit = (Signal(name=f"i_{n}") for n in ("write", "cell", "slot", "bit"))
        self.close, self.ready, self.chosen = Signal(), Signal(), Signal(range(4))
        self.ports = [self.write, self.cell, self.slot, self.bit, self.close, self.ready, self.chosen]

    def elaborate(self, platform: object) -> Module:
        m = Module()
        m.submodules.rows = rows = self.rows
        busy, touched, bits = Signal(), Array(Signal(name=f"touched{n}") for n in range(2)), Signal(2)
        now = [touched[n] | (self.write & (self.cell == n)) for n in range(2)]
        values = [Mux(self.write & (self.cell == n), self.bit, bits[n]) for n in range(2)]
        m.d.comb += [
            rows.i_write.eq(self.write),
            rows.i_cell.eq(self.cell),
            rows.i_slot.eq(self.slot),
            rows.i_feature.x.eq(self.bit),
            rows.i_order[0].taken.eq(1),
            rows.i_order[0].slot.eq(self.slot),
            rows.i_close.eq(self.close),
            rows.i_touched.eq(Cat(now)),
            rows.o.ready.eq(self.ready),
            Assume(~(self.close & busy)),
            Assume(~(self.write & touched[self.cell])),
        ]
        m.d.sync += busy.eq(self.close | (busy & ~rows.o_drained))
        for n in range(2):
            m.d.sync += [touched[n].eq(now[n] & ~self.close), bits[n].eq(values[n])]
        held(m, Assert, rows.o.valid, self.ready, Value.cast(rows.o.payload))
        self._leaves_in_order(m, now, values)
        return m

    def _leaves_in_order(self, m: Module, touched: list[Value], values: list[Value]) -> None:
        """A closed row's features by cell, then its end."""
        o = self.rows.o
        leaves, ends = o.valid & o.ready, o.p.ends_row
        arrivals = [(self.close & there, value) for there, value in zip(touched, values, strict=True)]
        leaves_in_order(
            m, [*arrivals, (self.close, Const(ROW_END))], leaves, Mux(ends, ROW_END, o.p.feature.x[0]),
            chosen=self.chosen, most=MAX_LEAVING,
        )  # fmt: skip
        features, rows = happened(m, leaves & ~ends, most=3), happened(m, leaves & ends, most=3)
        m.d.comb += [Cover((rows == 1) & (features == 3)), Cover(o.valid & ends & self.write & self.close)]


@pytest.mark.slow
def test_a_row_that_leaves_is_not_written(tmp_path: Path) -> None:
    prove(_Rows(), tmp_path)
