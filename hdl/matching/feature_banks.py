"""Three banks of features: reference and current frame are matched while the next frame fills the third."""

from amaranth import Array, Cat, Module, Mux, Signal
from amaranth.lib import data, stream
from amaranth.lib.wiring import In, Out

from golden_model.feature.ilbp import DescriptorPattern
from golden_model.feature.orientation import SECTORS
from golden_model.formats import POSITION
from golden_model.records import FRAME_STATUS, WORD_BYTES, Tag
from hdl.lib.component import Component
from hdl.lib.delay import delayed
from hdl.lib.line_memory import LineMemory
from hdl.streams import WordPayload, record_layout

ROLES = ("reference", "current", "filling")
READ_CYCLES = 1 + LineMemory.latency_cycles
"""Clocks from an address to its feature: a register before the memory, the memory, its output register."""


def banked_feature(pattern: DescriptorPattern) -> data.StructLayout:
    """What matching needs of a feature: position, descriptor; sector and gray window if the pattern has them."""
    return data.StructLayout(
        {
            "x": POSITION.bits,
            "y": POSITION.bits,
            "sector": range(SECTORS if pattern.oriented else 1),
            "descriptor": pattern.bits,
            "window": 8 * pattern.window_bytes,
        }
    )


class FeatureBanks(Component):
    """Stores frames of Feature records, and provides the features of the two frames to match.

    Features are written to the filling bank. When the FrameStatus of a good frame is accepted from ``o_status``, the
    banks swap roles in that clock; after a bad frame the filling bank is overwritten. The filling bank is never
    read, and the other two are never written.

    The first good frame becomes the reference. A later one becomes the current frame; the reference is then the
    previous current frame, or with ``i_hold_reference`` stays the same.

    Parameters
    ----------
    pattern : DescriptorPattern
        Pattern of the features' descriptors.
    max_features : int
        Features that a bank holds; a frame with more must be marked bad, or it would overwrite itself.
    """

    i: In(stream.Signature(WordPayload))
    """Stream of `hdl.streams.WordPayload`: records of one length; each frame ends with its FrameStatus."""
    o_status: stream.Interface
    """Stream of FrameStatus records. Accepting one changes the roles; ``i`` stalls until then."""
    i_hold_reference: In(1)
    """The reference stays the same. Sampled when the roles change."""
    i_take_reference: In(1)
    """The frame becomes the reference, and there is no current frame to match. Sampled when the roles change."""
    i_left_address: Signal
    i_right_address: Signal
    o_left: data.View
    """The reference's `banked_feature` at ``i_left_address``, ``READ_CYCLES`` later."""
    o_right: data.View
    """The current frame's `banked_feature` at ``i_right_address``, ``READ_CYCLES`` later."""
    o_left_count: Signal
    """Number of features of the reference."""
    o_right_count: Signal
    """Number of features of the current frame; 0 if there is nothing to match."""
    o_reference: Out(16)
    """Lower half of the reference's frame number."""

    def __init__(self, *, pattern: DescriptorPattern, max_features: int) -> None:
        self.max_features = max_features
        self._feature = banked_feature(pattern)
        record = pattern.record
        self._record = record_layout(record)
        self._status = record_layout(FRAME_STATUS, record.record_bytes)
        tag = self._record["tag"]
        self._tag = slice(tag.offset, tag.offset + tag.width)
        self._record_words = record.record_bytes // WORD_BYTES
        address, count = range(max_features), range(max_features + 1)
        super().__init__(
            o_status=Out(stream.Signature(self._status)),
            i_left_address=In(address),
            i_right_address=In(address),
            o_left=Out(self._feature),
            o_right=Out(self._feature),
            o_left_count=Out(count),
            o_right_count=Out(count),
        )

    def elaborate(self, platform: object) -> Module:
        """Collect records, store features, swap roles at a good status, read."""
        m = Module()
        complete, ends_frame, record = self._collect(m)
        feature = data.View(self._record, record)
        m.d.comb += [
            self.o_status.valid.eq(complete & ends_frame),
            self.o_status.payload.eq(record),
            self.i.ready.eq(~self.o_status.valid),
        ]
        reference, current, filling = self._swap_roles(m)
        features = []
        for n in range(len(ROLES)):
            m.submodules[f"bank{n}"] = bank = LineMemory(shape=self._feature, depth=self.max_features)
            m.d.comb += [
                bank.i_write.eq(complete & ~ends_frame & (filling == n)),
                bank.i_write_address.eq(feature.index),
                bank.i_read.eq(1),
                bank.i_read_address.eq(delayed(m, Mux(reference == n, self.i_left_address, self.i_right_address), 1)),
            ]
            word = data.View(self._feature, bank.i_word)
            for name, field in self._feature:
                # Sector and window have no bits where the pattern lacks them.
                if field.width:
                    m.d.comb += word[name].eq(feature[name])
            features.append(bank.o_word)
        m.d.comb += [self.o_left.eq(Array(features)[reference]), self.o_right.eq(Array(features)[current])]
        return m

    def _collect(self, m: Module) -> tuple[Signal, Signal, Signal]:
        """Assemble a record from words. ``complete`` is high for one clock; for a status, until it is accepted."""
        complete = Signal()
        ends_frame = Signal(reset_less=True)
        record = Signal(self._record.size, reset_less=True)
        word = Signal(range(self._record_words))
        incoming = self.i.payload.data
        with m.If(self.i.ready):
            m.d.sync += complete.eq(0)
            with m.If(self.i.valid):
                # Shifted in from the top: records are little-endian, so the first word ends up lowest.
                m.d.sync += [record.eq(Cat(record, incoming)[len(incoming) :]), word.eq(word + 1)]
                with m.If(word == 0):
                    # The tag is in the first word, but is needed as soon as the last has come.
                    m.d.sync += ends_frame.eq(incoming[self._tag] == Tag.FRAME_STATUS)
                with m.If(word == self._record_words - 1):
                    m.d.sync += [word.eq(0), complete.eq(1)]
        with m.Elif(self.o_status.ready):
            m.d.sync += complete.eq(0)
        return complete, ends_frame, record

    def _swap_roles(self, m: Module) -> tuple[Signal, Signal, Signal]:
        """Swap the roles at a good status; return the numbers of the reference, the current and the filling bank."""
        reference = Signal(range(len(ROLES)), init=0)
        current = Signal(range(len(ROLES)), init=1)
        filling = Signal(range(len(ROLES)), init=2)
        has_reference = Signal()
        has_current = Signal()
        right_number = Signal.like(self.o_reference)
        status = self.o_status.payload
        with m.If(self.o_status.valid & self.o_status.ready & status.good):
            with m.If(self.i_take_reference | ~has_reference):
                m.d.sync += [reference.eq(filling), filling.eq(reference), self.o_left_count.eq(status.features)]
                m.d.sync += [self.o_right_count.eq(0), has_reference.eq(1), has_current.eq(0)]
                m.d.sync += self.o_reference.eq(status.frame)
            with m.Else():
                m.d.sync += [current.eq(filling), self.o_right_count.eq(status.features), has_current.eq(1)]
                m.d.sync += right_number.eq(status.frame)
                with m.If(has_current & ~self.i_hold_reference):
                    m.d.sync += [reference.eq(current), filling.eq(reference), self.o_left_count.eq(self.o_right_count)]
                    m.d.sync += self.o_reference.eq(right_number)
                # The reference keeps its bank. The previous current frame's bank is free, or was never filled.
                with m.Else():
                    m.d.sync += filling.eq(current)
        return reference, current, filling
