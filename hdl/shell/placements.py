"""Where frames lie, for the painter: the homographies of the chip, and between them the poses that a host sets."""

from amaranth import Cat, Module, Mux, Signal
from amaranth.lib import data, fifo, stream, wiring
from amaranth.lib.wiring import In, Out

from golden_model.records import ELEMENTS, HOMOGRAPHY, WORD_BYTES, Tag
from hdl.geometry.records import RECORD_WORDS, RecordCollector
from hdl.lib.views import view_signal
from hdl.painting.frame_writer import FRAME_NUMBER
from hdl.painting.painter import NOWHERE
from hdl.painting.pose import PLACEMENT
from hdl.streams import WordPayload, record_layout

MAX_WAITING = 8
"""Records that wait for the painter: a frame that takes long to be painted holds them up."""
HOST_POSE = data.StructLayout({"elements": PLACEMENT["elements"].shape, "frame": FRAME_NUMBER})
"""A pose as the registers have it: its elements row by row, and the number of its frame."""


class Placements(wiring.Component):
    """Makes placements (`golden_model.painting.pose.placement_of`) of records, and of poses that a host sets.

    A record with causes says nothing of its frame but that it has no place. A host's pose goes before the records that
    wait, since those are of later frames, but never into one that is being taken. Nothing here makes the records wait:
    of those that come while `MAX_WAITING` wait, none is taken.

    The accelerator counts frames from 0, the painter from 1. A reset forgets all that waits.
    """

    i: In(stream.Signature(WordPayload))
    """Packets of one `golden_model.records.HOMOGRAPHY`; ready is always 1. Where nothing waits, it is 3 clocks
    from the last word to ``o``."""
    i_enable: In(1)
    """Take the records that begin."""
    i_pose: In(HOST_POSE)
    i_set: In(1)
    """Take the host's pose, unless ``o_waiting``."""
    o: Out(stream.Signature(PLACEMENT))
    o_nowhere: Out(NOWHERE)
    """A record with causes is passed over in this clock."""
    o_waiting: Out(1)
    """A host's pose has not been taken from ``o`` yet."""
    o_ignored: Out(1)
    """A host's pose is ignored in this clock, because another one waits."""
    o_lost: Out(1)
    """A record is passed over in this clock, because too many wait."""

    def elaborate(self, platform: object) -> Module:
        """A queue of words, a record, and a host's pose; one of the two is offered."""
        m = Module()
        m.submodules.record = record = RecordCollector(record=HOMOGRAPHY)
        self._queue(m, record)
        found, taken = data.View(record_layout(HOMOGRAPHY), record.o.payload.record), self.o.payload
        host = view_signal(HOST_POSE, name="host")
        is_hosts = Signal()
        m.d.comb += self.o_ignored.eq(self.i_set & self.o_waiting)
        with m.If(self.i_set & ~self.o_waiting):
            m.d.sync += [host.eq(self.i_pose), self.o_waiting.eq(1)]
        m.d.comb += [
            *(
                element.eq(Mux(is_hosts, host.elements[n], found[ELEMENTS[n]].as_signed()))
                for n, element in enumerate(taken.elements)
            ),
            taken.frame.eq(Mux(is_hosts, host.frame, found.frame) + 1),
            # As its own reference, a host's pose does not keep that of another frame.
            taken.reference.eq(Mux(is_hosts, host.frame, found.reference) + 1),
            taken.composed.eq(~is_hosts),
            self.o_nowhere.frame.eq(found.frame + 1),
        ]
        with m.FSM():
            with m.State("CHOOSE"):
                m.d.sync += is_hosts.eq(self.o_waiting)
                is_whole = record.o.valid & ~record.o.payload.cut & (found.tag == Tag.HOMOGRAPHY)
                with m.If(self.o_waiting | (is_whole & ~found.causes.any())):
                    m.next = "OFFER"
                with m.Else():
                    m.d.comb += [record.o.ready.eq(1), self.o_nowhere.valid.eq(is_whole)]
            with m.State("OFFER"):
                m.d.comb += [self.o.valid.eq(1), record.o.ready.eq(self.o.ready & ~is_hosts)]
                with m.If(self.o.ready):
                    m.d.sync += self.o_waiting.eq(self.o_waiting & ~is_hosts)
                    m.next = "CHOOSE"
        return m

    def _queue(self, m: Module, record: RecordCollector) -> None:
        """Queue whole records, where there is room for all of their words."""
        m.submodules.queue = queue = fifo.SyncFIFOBuffered(width=8 * WORD_BYTES + 1, depth=MAX_WAITING * RECORD_WORDS)
        begins, takes, took = Signal(init=1), Signal(), Signal()
        has_room = queue.w_level <= queue.depth - RECORD_WORDS
        m.d.comb += [
            self.i.ready.eq(1),
            takes.eq(Mux(begins, self.i_enable & has_room, took)),
            self.o_lost.eq(self.i.valid & begins & self.i_enable & ~has_room),
            queue.w_en.eq(self.i.valid & takes),
            queue.w_data.eq(Cat(self.i.payload.data, self.i.payload.last)),
            record.i.valid.eq(queue.r_rdy),
            Cat(record.i.payload.data, record.i.payload.last).eq(queue.r_data),
            queue.r_en.eq(record.i.ready),
        ]
        with m.If(self.i.valid):
            m.d.sync += [begins.eq(self.i.payload.last), took.eq(takes)]
