"""Poses, set by a host or composed: one serial sum of products, and a memory for its words."""

import enum

from amaranth import Array, Cat, Const, Module, Mux, Signal, Value, signed
from amaranth.lib import data, stream, wiring
from amaranth.lib.wiring import In, Out

from golden_model.geometry.fixed_point import ENTRY
from golden_model.painting.pose import ELEMENT, MAX_LINKS, MIN_DETERMINANT, POSE, SUM_SHIFT, PoseCause
from hdl.lib.delay import delayed
from hdl.lib.line_memory import LineMemory
from hdl.lib.views import view_signal
from hdl.painting.serial_sum import TERMS, SerialSum

COLUMN = data.StructLayout({name: signed(ELEMENT.bits) for name in "xyw"})
"""A column of a pose. A pose is three of these in turn: what is constant, and the factors of X and Y."""
ELEMENTS = 9
PLACEMENT = data.StructLayout(
    {"elements": data.ArrayLayout(signed(32), ELEMENTS), "frame": 16, "reference": 16, "composed": 1}
)
"""`golden_model.painting.pose.Placement`; the elements row by row."""
CAUSES = len(PoseCause)
"""Bits of `PoseCause`."""
DETERMINANT = ELEMENTS + TERMS
"""Sums 0 to 8 are the elements of a composed pose, 9 to 11 minors, and then comes the determinant."""
FIRST_COLUMN = DETERMINANT + 1
"""The words of three columns are only read."""


class Area(enum.IntEnum):
    """Where a sum finds its words: there is room for a homography and three poses, which take turns."""

    HOMOGRAPHY = 0
    REFERENCE = 1
    NEW = 2


def factors(number: int) -> tuple[list[tuple[Area, int]], list[tuple[Area, int]]]:
    """Area and index of the words whose products make a sum, both factors of each; see `DETERMINANT`."""
    terms = range(TERMS)
    if number < ELEMENTS:
        row, column = divmod(number, TERMS)
        return [(Area.HOMOGRAPHY, 3 * row + k) for k in terms], [(Area.REFERENCE, 3 * k + column) for k in terms]
    if number < DETERMINANT:
        # Second row times third row, the second product with a minus; nothing is loaded for a third one.
        after, before = (number + 1) % 3, (number + 2) % 3
        return [(Area.NEW, 3 + (after + k) % 3) for k in terms], [(Area.NEW, 6 + (before + 2 * k) % 3) for k in terms]
    if number == DETERMINANT:
        return [(Area.NEW, k) for k in terms], [(Area.NEW, ELEMENTS + k) for k in terms]
    column = (2, 0, 1)[number - FIRST_COLUMN]
    return [(Area.NEW, 3 * k + column) for k in terms], [(Area.NEW, 0)] * TERMS


KEPT = data.StructLayout({"valid": 1, "frame": 16, "links": range(MAX_LINKS + 1)})
"""A pose that others can be composed with."""
AREA_WORDS = 16
HOMOGRAPHY_AREA, FIRST_AREA = 0, 1
READ_CYCLES = 1 + LineMemory.latency_cycles
"""From `PoseInWork.reads` to the word. Its address comes out of a table, hence a register before the memory."""
SUM_CYCLES = READ_CYCLES + SerialSum.latency_cycles
"""From `PoseInWork.has_read_sum` to the sum."""


class PoseInWork:
    """What the parts of `Poses` tell each other."""

    def __init__(self) -> None:
        self.number = Signal(range(AREA_WORDS))
        """The sum, or the column, in work."""
        self.copies = Signal()
        """An element is copied in this clock."""
        self.has_copied = Signal()
        """It is the last one."""
        self.is_copied = Signal()
        """That is written, and all checks are done."""
        self.reads = Signal()
        """A word of the sum is read in this clock."""
        self.has_read_column = Signal()
        """It is the last one of a column."""
        self.has_read_sum = Signal()
        """It is the last one of a sum."""
        self.doubles = Signal()
        self.stores = Signal()
        """The sum is stored in this clock."""
        self.surveys = Signal()
        """It only counts for the headroom."""
        self.measures = Signal()
        """Counts the headroom in this clock."""
        self.headroom = Signal(range(SUM_SHIFT + 1))
        """Bits by which all elements are shifted to the left, before the lowest are dropped."""
        self.is_measured = Signal()
        self.is_singular = Signal()
        self.causes = Signal(CAUSES)
        """Without what only the determinant can tell."""
        self.keeps = Signal()
        """The new pose is kept."""
        self.base_area, self.new_area = Signal(2), Signal(2)


class Poses(wiring.Component):
    """The pose of each frame; equal to `golden_model.painting.pose.Poses`.

    A composed pose takes at most 2,200 clocks and one that a host sets 400, until its first column is offered. Sums are
    computed twice: first to see by how many bits all of them can be shifted, then to store them.
    """

    i: In(stream.Signature(PLACEMENT))
    """Taken when its pose has left, or is refused."""
    i_max_links: In(range(MAX_LINKS + 1))
    """Homographies that may be composed after a host's pose."""
    o: Out(stream.Signature(COLUMN))
    o_refused: Out(1)
    """The placement that is taken in this clock has no pose."""
    o_causes: Out(CAUSES)
    """With ``o_refused``: why."""

    def elaborate(self, platform: object) -> Module:
        """Copy elements, compose, take the determinant, send columns."""
        m = Module()
        m.submodules.memory = memory = LineMemory(shape=signed(POSE.bits), depth=4 * AREA_WORDS)
        m.submodules.sum = products = SerialSum()
        work = PoseInWork()
        in_range = self._write(m, work, memory, products.o)
        self._keep(m, work, in_range)
        self._read(m, work, memory, products)
        self._measure(m, work, products.o)
        self._lead(m, work)
        return m

    def _write(self, m: Module, work: PoseInWork, memory: LineMemory, total: Value) -> Value:
        """Write elements and sums into the memory; whether all elements are in range."""
        element = Signal(range(ELEMENTS))
        is_last = element == ELEMENTS - 1
        with m.If(work.copies):
            m.d.sync += element.eq(Mux(is_last, 0, element + 1))
        copied = delayed(m, self.i.payload.elements[element], 1)
        index = delayed(m, element, 1)
        is_copy = delayed(m, work.copies, 1, reset_less=False)
        # A host's elements are the pose.
        area = Mux(is_copy & self.i.payload.composed, HOMOGRAPHY_AREA, work.new_area)
        m.d.comb += [
            work.has_copied.eq(work.copies & is_last),
            work.is_copied.eq(delayed(m, work.has_copied, 2, reset_less=False)),
            memory.i_write.eq(is_copy | work.stores),
            memory.i_write_address.eq(Cat(Mux(is_copy, index, work.number), area)),
            memory.i_word.eq(Mux(is_copy, copied << POSE.bits - ENTRY.bits, total >> SUM_SHIFT)),
        ]
        beyond = copied[ENTRY.bits - 1 :]
        in_range = Signal()
        with m.If(is_copy):
            m.d.sync += in_range.eq((in_range | (index == 0)) & (beyond.all() | ~beyond.any()))
        return in_range

    def _keep(self, m: Module, work: PoseInWork, in_range: Value) -> None:
        """Two places: a pose replaces that of its frame, or else not that of the reference; one area is spare."""
        sent = self.i.payload
        places = [view_signal(KEPT, name=f"place{n}") for n in range(2)]
        areas = [Signal(2, name=f"area{n}", init=FIRST_AREA + n) for n in range(2)]
        spare = Signal(2, init=FIRST_AREA + 2)
        newest, base, target, is_known = Signal(), Signal(), Signal(), Signal()
        known = Cat(each.valid & (each.frame == sent.reference) & (sent.reference != sent.frame) for each in places)
        own = Cat(each.valid & (each.frame == sent.frame) for each in places)
        links = Mux(base, places[1].links, places[0].links)
        # All are registers, which follow while the elements are copied.
        m.d.sync += [
            is_known.eq(known.any()),
            base.eq(Mux(known.any(), known[1], newest)),
            target.eq(Mux(own.any(), own[1], ~Mux(known.any(), known[1], newest))),
            work.base_area.eq(Mux(base, areas[1], areas[0])),
        ]
        m.d.comb += [
            work.new_area.eq(spare),
            work.causes.eq(
                Mux(in_range, 0, PoseCause.OUT_OF_RANGE)
                | Mux(sent.composed & ~is_known, PoseCause.UNKNOWN_REFERENCE, 0)
                | Mux(sent.composed & is_known & (links >= self.i_max_links), PoseCause.UNANCHORED, 0)
            ),
        ]
        for n, (place, area) in enumerate(zip(places, areas, strict=True)):
            with m.If(work.keeps & (target == n)):
                m.d.sync += [
                    place.valid.eq(1),
                    place.frame.eq(sent.frame),
                    place.links.eq(Mux(sent.composed, links + 1, 0)),
                ]
                m.d.sync += [newest.eq(n), area.eq(spare), spare.eq(area)]

    def _read(self, m: Module, work: PoseInWork, memory: LineMemory, products: SerialSum) -> None:
        """Address words; pass them on to the sum, and to the output's column."""
        term, round_ = Signal(range(TERMS)), Signal(range(ENTRY.bits + 1))
        ends_round = work.reads & (term == TERMS - 1)
        m.d.comb += [work.has_read_column.eq(ends_round), work.has_read_sum.eq(ends_round & (round_ == ENTRY.bits))]
        with m.If(work.reads):
            m.d.sync += term.eq(Mux(ends_round, 0, term + 1))
            with m.If(ends_round):
                is_column = work.number >= FIRST_COLUMN
                m.d.sync += round_.eq(Mux(work.has_read_sum | is_column, 0, round_ + 1))
        is_second = round_ != 0
        groups = [each for number in range(AREA_WORDS) for each in factors(number)]
        # Four entries for three terms, so that each group starts at a multiple of 4.
        entries = [entry for group in groups for entry in [*group, group[0]]]
        entry = Cat(term, is_second, work.number)
        index = Array(Const(index, range(AREA_WORDS)) for _, index in entries)[entry]
        area = Array(Const(area, 2) for area, _ in entries)[entry]
        base = Array([Const(HOMOGRAPHY_AREA, 2), work.base_area, work.new_area])[area]
        m.d.comb += [memory.i_read.eq(1), memory.i_read_address.eq(delayed(m, Cat(index, base), 1))]
        is_minor = (work.number >= ELEMENTS) & (work.number < DETERMINANT)
        m.d.comb += [
            products.i_valid.eq(delayed(m, work.reads, READ_CYCLES, reset_less=False)),
            products.i_word.eq(memory.o_word),
            products.i_second.eq(delayed(m, is_second, READ_CYCLES)),
            products.i_term.eq(delayed(m, term, READ_CYCLES)),
            products.i_first_bit.eq(delayed(m, round_ == 1, READ_CYCLES)),
            products.i_subtract.eq(delayed(m, is_minor & (term == 1), READ_CYCLES)),
            products.i_skip.eq(delayed(m, is_minor & (term == TERMS - 1), READ_CYCLES)),
            products.i_double.eq(work.doubles),
        ]
        column = Signal(len(Value.cast(self.o.payload)), reset_less=True)
        m.d.comb += Value.cast(self.o.payload).eq(column)
        with m.If(products.i_valid):
            m.d.sync += column.eq(Cat(column, memory.o_word[POSE.bits - ELEMENT.bits :])[ELEMENT.bits :])

    def _measure(self, m: Module, work: PoseInWork, total: Value) -> None:
        """Find the leading bit of the largest sum, and whether a sum is too small for a determinant."""
        magnitude = total[:-1] ^ total[-1].replicate(len(total) - 1)
        # The headroom is at most as many bits.
        used = Signal(SUM_SHIFT)
        with m.If(work.copies):
            m.d.sync += [used.eq(0), work.headroom.eq(0)]
        with m.If(work.surveys):
            m.d.sync += used.eq(used | magnitude[-SUM_SHIFT:])
        m.d.comb += work.is_measured.eq(used[-1] | (work.headroom == SUM_SHIFT))
        with m.If(work.measures & ~work.is_measured):
            m.d.sync += [used.eq(used << 1), work.headroom.eq(work.headroom + 1)]
        m.d.comb += work.is_singular.eq(total[-1] | ~total[MIN_DETERMINANT.bit_length() - 1 :].any())

    def _lead(self, m: Module, work: PoseInWork) -> None:
        with m.FSM():
            with m.State("idle"), m.If(self.i.valid):
                m.next = "copy"
            with m.State("copy"):
                m.d.comb += work.copies.eq(1)
                with m.If(work.has_copied):
                    m.next = "check"
            with m.State("check"), m.If(work.is_copied):
                m.d.sync += work.number.eq(Mux(self.i.payload.composed, 0, ELEMENTS))
                m.d.sync += self.o_causes.eq(work.causes)
                m.next = "read sum"
                with m.If(work.causes.any()):
                    m.next = "refuse"
            self._add_sums(m, work)
            self._send(m, work)
            with m.State("take"):
                m.d.comb += [self.i.ready.eq(1), work.keeps.eq(1)]
                m.next = "idle"
            with m.State("refuse"):
                m.d.comb += [self.i.ready.eq(1), self.o_refused.eq(1)]
                m.next = "idle"

    def _add_sums(self, m: Module, work: PoseInWork) -> None:
        number, left = work.number, Signal.like(work.headroom)
        has_sum = delayed(m, work.has_read_sum, SUM_CYCLES, reset_less=False)
        is_second_pass = Signal()
        with m.State("read sum"):
            m.d.comb += work.reads.eq(1)
            with m.If(work.has_read_sum):
                m.next = "add"
        with m.State("add"), m.If(has_sum):
            m.next = "store"
            with m.If(number == DETERMINANT):
                m.d.sync += [number.eq(FIRST_COLUMN), self.o_causes.eq(PoseCause.SINGULAR)]
                m.next = "read column"
                with m.If(work.is_singular):
                    m.next = "refuse"
            with m.Elif((number < ELEMENTS) & is_second_pass):
                m.d.sync += left.eq(work.headroom)
                m.next = "shift"
            with m.Elif(number < ELEMENTS):
                m.d.comb += work.surveys.eq(1)
                m.d.sync += number.eq(Mux(number == ELEMENTS - 1, 0, number + 1))
                m.next = "read sum"
                with m.If(number == ELEMENTS - 1):
                    m.next = "measure"
        with m.State("measure"):
            m.d.comb += work.measures.eq(1)
            m.d.sync += is_second_pass.eq(1)
            with m.If(work.is_measured):
                m.next = "read sum"
        with m.State("shift"):
            m.d.comb += work.doubles.eq(left != 0)
            m.d.sync += left.eq(left - 1)
            with m.If(left == 0):
                m.next = "store"
        with m.State("store"):
            m.d.comb += work.stores.eq(1)
            m.d.sync += number.eq(number + 1)
            with m.If(number == ELEMENTS - 1):
                m.d.sync += is_second_pass.eq(0)
            m.next = "read sum"

    def _send(self, m: Module, work: PoseInWork) -> None:
        has_column = delayed(m, work.has_read_column, READ_CYCLES + 1, reset_less=False)
        with m.State("read column"):
            m.d.comb += work.reads.eq(1)
            with m.If(work.has_read_column):
                m.next = "wait"
        with m.State("wait"), m.If(has_column):
            m.next = "offer"
        with m.State("offer"):
            m.d.comb += self.o.valid.eq(1)
            with m.If(self.o.ready):
                m.d.sync += work.number.eq(work.number + 1)
                m.next = "read column"
                with m.If(work.number == AREA_WORDS - 1):
                    m.next = "take"
