"""The streaming shell around the accelerator: the camera before it, rings in memory behind it."""

from amaranth import Cat, Module, Mux, ResetInserter, Signal, Value
from amaranth.lib import fifo, stream, wiring
from amaranth.lib.wiring import In, Out

from hdl.axi.axi_write import AXI_WRITE
from hdl.axi.video_input import VideoPayload
from hdl.registers.register_file import RegisterFile
from hdl.settings import MIN_SLOTS, PAGE_BYTES, TICK_CLOCKS
from hdl.shell.camera import CameraCrossing, CameraGate
from hdl.shell.painting import Painting
from hdl.shell.ring_writer import FRAME_INFO, RingWriter
from hdl.streams import WordPayload, fork

MAX_IN_FLIGHT = 8
"""Frames between the camera's gate and the end of their packets; the accelerator itself holds about four."""
CLEARING_CLOCKS = 8
"""Clocks from CONTROL.clear until the accelerator's outputs offer the rest of a packet, at most."""


class Shell(wiring.Component):
    """Admits whole frames of a camera while there are buffers for them, and writes their packets into rings.

    An admitted frame has a free slot in each ring that is on, reserved for it alone. Software frees slots by counting
    up ``features_read``, ``matches_read`` and ``homographies_read``.

    Parameters
    ----------
    registers : RegisterFile
        The registers of a camera build; the shell drives the fields of its own.
    record_words, max_words : mapping of str to int
        For each ring that is built, the length of a record and of the longest packet.
    video_bits : {24, 8}
    camera_depth, fifo_words : int
        Lengths of the queues before and behind the accelerator, in pixels and words. A ring's queue is shorter where
        it then holds all packets in flight: its sender, the estimator, never waits, and so drops no record.
    painting : Painting, optional
        It sees the frames that the accelerator sees and the records of the ring of homographies; the owner connects its
        ports to memory.
    """

    i_camera_valid: In(1)
    """In the domain ``camera``, as ``i_camera``."""
    i_camera: In(VideoPayload)
    """A pixel in each clock with valid."""
    o_video: Out(stream.Signature(VideoPayload))
    """To the accelerator; its ready must not depend on its valid."""
    i_features: In(stream.Signature(WordPayload))
    """From the accelerator: a packet for every frame of ``o_video``."""
    i_matches: In(stream.Signature(WordPayload))
    """From the accelerator: a packet for every frame of ``o_video``."""
    i_homographies: In(stream.Signature(WordPayload))
    """From the accelerator: a packet for every frame of ``o_video``; unused without this ring."""
    features: Out(AXI_WRITE)
    """The ring of features in memory."""
    matches: Out(AXI_WRITE)
    """The ring of matches in memory."""
    homographies: Out(AXI_WRITE)
    """The ring of homographies in memory; unused without it."""

    def __init__(
        self,
        *,
        registers: RegisterFile,
        record_words: dict[str, int],
        max_words: dict[str, int],
        video_bits: int,
        camera_depth: int,
        fifo_words: int,
        painting: Painting | None = None,
    ) -> None:
        self._registers = registers
        self._painting = painting
        self._crossing = CameraCrossing(video_bits=video_bits, depth=camera_depth)
        self._gate = CameraGate()
        self.rings = {
            ring: RingWriter(
                record_words=record_words[ring],
                max_words=max_words[ring],
                fifo_words=min(fifo_words, MAX_IN_FLIGHT * max_words[ring]),
            )
            for ring in record_words
        }
        super().__init__()

    def elaborate(self, platform: object) -> Module:
        """Connect crossing, gate, rings and registers."""
        m = Module()
        registers, gate, crossing = self._registers, self._gate, self._crossing
        m.submodules.crossing, m.submodules.gate = crossing, gate
        wiring.connect(m, crossing.o, gate.i)
        wiring.connect(m, gate.o, wiring.flipped(self.o_video))
        # 64 bits: at 150 MHz 32 would wrap twice a minute.
        time = Signal(64)
        m.d.sync += time.eq(time + 1)
        clearing, forgets = self._clear(m)
        if self._painting is not None:
            # The painter sees each pixel that the accelerator takes; a clear begins anew.
            m.submodules.painting = self._painting
            m.d.comb += [
                self._painting.i_forget.eq(forgets),
                self._painting.i_valid.eq(self.o_video.valid & self.o_video.ready),
                self._painting.i.eq(self.o_video.payload),
                self._painting.i_stop.eq(clearing),
            ]
        has_room, faults = {}, {}
        for ring in self.rings:
            has_room[ring], faults[ring] = self._ring(m, ring, time, forgets)
        if "homographies" in self.rings:
            m.d.comb += registers.i_homographies_refused.eq(faults["homographies"])
        m.d.comb += [
            # Memory mode cuts a stream by SIZE and ignores the camera's starts of frame.
            registers.i_refused.eq(Cat(faults["features"], faults["matches"], registers.o_memory_mode)),
            registers.i_clearing.eq(clearing),
            crossing.i_valid.eq(self.i_camera_valid),
            crossing.i.eq(self.i_camera),
            gate.i_pressed.eq(crossing.o_pressed),
            gate.i_on.eq(registers.o_enable & ~clearing),
            gate.i_refused.eq(Cat(*faults.values(), registers.o_memory_mode).any()),
            gate.i_has_room.eq(Cat(*has_room.values()).all()),
            gate.i_width_px.eq(registers.o_width_px),
            gate.i_height_px.eq(registers.o_height_px),
            gate.i_time.eq(time),
            registers.i_camera_frames.eq(gate.o_frames),
            registers.i_dropped.eq(gate.o_dropped),
            registers.i_cut.eq(gate.o_cut),
            registers.i_dropped_number.eq(gate.o_last_drop.number),
            Cat(registers.i_dropped_time_low, registers.i_dropped_time_high).eq(gate.o_last_drop.time),
            registers.i_dropped_reason.eq(gate.o_reason),
            registers.i_frame_dropped.eq(gate.o_drops),
            registers.i_memory_error.eq(Cat(ring.o_error for ring in self.rings.values()).any()),
        ]
        tick = time[: (TICK_CLOCKS - 1).bit_length()].all()
        self._watch(m, tick)
        self._coalesce(m, tick, forgets)
        return m

    def _clear(self, m: Module) -> tuple[Value, Value]:
        """Whether frames wait for a clear to end, and the clock in which the frames in flight are forgotten.

        A clear ends when the packets that the accelerator still offered are in memory, and nothing is being painted.
        """
        clearing = Signal()
        clocks = Signal(range(CLEARING_CLOCKS))
        offered = Cat(getattr(self, f"i_{ring}").valid for ring in self.rings).any()
        writers = (*self.rings.values(), *((self._painting,) if self._painting is not None else ()))
        quiet = Cat(writer.o_idle for writer in writers).all() & ~offered
        forgets = clearing & (clocks == CLEARING_CLOCKS - 1) & quiet
        with m.If(self._registers.o_clear):
            m.d.sync += [clearing.eq(1), clocks.eq(0)]
        with m.Elif(forgets):
            m.d.sync += clearing.eq(0)
        with m.Elif(clocks != CLEARING_CLOCKS - 1):
            m.d.sync += clocks.eq(clocks + 1)
        return clearing | self._registers.o_clear, forgets

    def _ring(self, m: Module, ring: str, time: Value, forgets: Value) -> tuple[Value, Value]:
        """Add a ring; returns whether it has room for another frame, and the faults of its settings (`Refusal`)."""
        writer, gate, painting = self.rings[ring], self._gate, self._painting
        m.submodules[ring] = writer
        m.submodules[f"{ring}_infos"] = infos = ResetInserter(forgets)(
            fifo.SyncFIFO(width=FRAME_INFO.size, depth=MAX_IN_FLIGHT)
        )
        # The homographies also go to the painter.
        taps = (painting.i_homographies,) if ring == "homographies" and painting is not None else ()
        fork(m, getattr(self, f"i_{ring}"), writer.i, *taps)
        wiring.connect(m, writer.bus, wiring.flipped(getattr(self, ring)))
        enable = getattr(self._registers, f"o_{ring}_enable")
        base_low, base_high, slots, slot_pages, read = (
            getattr(self._registers, f"o_{ring}_{name}")
            for name in ("base_low", "base_high", "slots", "slot_pages", "read")
        )
        in_flight = Signal(range(MAX_IN_FLIGHT + 1))
        used = Signal(32)
        faults = Signal(3)
        m.d.comb += used.eq(writer.o_written - read)
        m.d.sync += [
            in_flight.eq(Mux(forgets, 0, in_flight + gate.o_admits - (writer.o_ended & in_flight.any()))),
            # Checked while the ring is off, too: a fault has to be known in the clock in which it is switched on.
            faults.eq(
                Cat(
                    base_low[: (PAGE_BYTES - 1).bit_length()].any(),
                    (slots < MIN_SLOTS) | (slot_pages < writer.needed_pages),
                    used > slots,
                )
            ),
        ]
        m.d.comb += [
            infos.w_en.eq(gate.o_admits),
            infos.w_data.eq(gate.o_info),
            writer.i_info.valid.eq(infos.r_rdy),
            writer.i_info.payload.eq(infos.r_data),
            infos.r_en.eq(writer.i_info.ready),
            writer.i_enable.eq(enable & ~faults[:2].any()),
            writer.i_base_page.eq(Cat(base_low, base_high)[(PAGE_BYTES - 1).bit_length() :]),
            writer.i_slots.eq(slots),
            writer.i_slot_pages.eq(slot_pages),
            writer.i_full.eq(used >= slots),
            writer.i_time.eq(time),
        ]
        for name in ("written", "errors", "lost", "active"):
            m.d.comb += getattr(self._registers, f"i_{ring}_{name}").eq(getattr(writer, f"o_{name}"))
        # A ring that is off needs no slot.
        has_room = (in_flight != MAX_IN_FLIGHT) & (~enable | (used + in_flight < slots))
        return has_room, Mux(enable, faults, 0)

    def _watch(self, m: Module, tick: Value) -> None:
        """Report that the camera has stopped when no pixel has come for longer than ``camera_timeout``."""
        registers, stopped = self._registers, self._registers.i_camera_stopped
        idle = Signal(registers.o_camera_timeout.shape())
        m.d.sync += registers.i_camera_stops.eq(0)
        with m.If(self._gate.i.valid):
            m.d.sync += [idle.eq(0), stopped.eq(0)]
        with m.Elif(tick & registers.o_camera_timeout.any() & ~stopped):
            m.d.sync += idle.eq(idle + 1)
            # At least `idle` units have passed since the first of its ticks. Not ==: software may shorten the time.
            with m.If(idle >= registers.o_camera_timeout):
                m.d.sync += [stopped.eq(1), registers.i_camera_stops.eq(registers.o_enable)]

    def _coalesce(self, m: Module, tick: Value, forgets: Value) -> None:
        """Raise an event after ``coalesce_count`` complete frames, or when the first has waited long enough."""
        registers = self._registers
        # Packets that have ended in one ring and not yet in every other.
        ahead = {ring: Signal(range(MAX_IN_FLIGHT + 2), name=f"{ring}_ahead") for ring in self.rings}
        complete = Cat(signal.any() for signal in ahead.values()).all()
        pending = Signal(registers.o_coalesce_count.shape())
        waited = Signal(registers.o_coalesce_timeout.shape())
        for ring, signal in ahead.items():
            m.d.sync += signal.eq(Mux(forgets, 0, signal + self.rings[ring].o_ended - complete))
        timeout = registers.o_coalesce_timeout
        fires = pending.any() & ((pending >= registers.o_coalesce_count) | (timeout.any() & (waited >= timeout)))
        m.d.comb += registers.i_frames_ready.eq(fires)
        with m.If(fires):
            m.d.sync += [pending.eq(complete), waited.eq(0)]
        with m.Else():
            # At its largest value it fires, whatever the count.
            m.d.sync += pending.eq(pending + complete)
            with m.If(pending.any() & tick):
                m.d.sync += waited.eq(waited + 1)
