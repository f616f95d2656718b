"""The whole accelerator: AXI4-Stream video in, features, matches and homographies out, registers on AXI4-Lite."""

from amaranth import ClockDomain, ClockSignal, Module, ResetInserter, Signal
from amaranth.lib import data, fifo, stream, wiring
from amaranth.lib.wiring import In, Out

from golden_model.geometry.estimator import MAX_MATCHES
from golden_model.records import MATCH
from hdl.axi.axi_lite import AXI_LITE
from hdl.axi.flat_ports import FlatTop, bus_pins, packet_pins, stream_pins
from hdl.axi.packet_gate import CLOSING_RECORDS, PacketGate
from hdl.axi.video_input import video_payload
from hdl.build import Build
from hdl.front_end import FrontEnd
from hdl.geometry.records import RecordEstimator
from hdl.lib.component import Component
from hdl.lib.skid_buffer import SkidBuffer
from hdl.lib.views import view_signal
from hdl.matching.matcher import Matcher
from hdl.registers.register_file import RegisterFile
from hdl.registers.register_map import built_constants
from hdl.registers.shell_register_map import list_registers
from hdl.settings import ESTIMATION, FRONT_END, KEEP_ABOVE
from hdl.streams import WordPayload, fork

MATCHING_SETTINGS = data.StructLayout({KEEP_ABOVE.name: KEEP_ABOVE.bits, "hold_reference": 1, "take_reference": 1})
"""Settings and request of the matcher, which each frame has of its own."""
ENDED_FRAMES = 4
"""At least as many as can have ended before the matcher takes the first: one in a bank, one in the front end, and a
status without features in the buffers between them."""


class Accelerator(Component):
    """Front end and matcher behind registers, in the domain ``sync``.

    Resets take effect one clock later, through one register for the data path and one for registers and outputs. A
    write to ``clear`` resets the data path only; the outputs then end the packets under way (`PacketGate`). The domain
    needs no reset of its own: without one, no register of the data path sees two resets.

    Features go to their output and to the matcher at the same time; the slower of the two sets the pace. An output
    that is disabled discards its packets, so that no DMA has to read it.

    The estimator takes the matches beside their output. It needs at most `golden_model.geometry.estimator.MAX_CYCLES`,
    for which the matcher waits before it takes the next frame: whether the frame before becomes the reference depends
    on its homography (`golden_model.matching.matcher.ReferenceFrame`).

    Parameters
    ----------
    build : Build
        With the shell ``camera``, the outputs pass every packet: it discards those of a ring that is off, so that it
        sees one packet per frame.
    """

    i_reset: In(1)
    """Synchronous reset of everything."""
    i_video: stream.Interface
    """Stream of `hdl.axi.video_input.video_payload`."""
    o_features: Out(stream.Signature(WordPayload))
    """Stream of `hdl.streams.WordPayload`, one packet per frame: its Feature records, then its FrameStatus."""
    o_matches: Out(stream.Signature(WordPayload))
    """Stream of `hdl.streams.WordPayload`, one packet per frame: its Match records, then its FrameStatus."""
    o_homographies: stream.Interface
    """Stream of `hdl.streams.WordPayload`, one Homography record per frame; only with ``config.estimator``."""
    control: In(AXI_LITE)
    """`hdl.registers.register_map`."""
    o_interrupt: Out(1)
    """Active high, level; software clears an event by writing 1."""

    registers: RegisterFile

    def __init__(self, build: Build) -> None:
        self.build, config = build, build.config
        self._has_shell = build.shell == "camera"
        self.registers = RegisterFile(constants=built_constants(build), registers=list_registers(build))
        self._front_end = FrontEnd(build)
        self._matcher = Matcher(
            config=config.matcher,
            pattern=config.front_end.pattern,
            lanes=build.lanes,
            max_features=config.front_end.max_features,
        )
        self._feature_gate = PacketGate(record_bytes=self.registers.constants["built_feature_bytes"])
        self._match_gate = PacketGate(record_bytes=MATCH.record_bytes)
        self._estimator = None
        if config.estimator:
            self._estimator = RecordEstimator(max_matches=min(config.front_end.max_features, MAX_MATCHES))
        super().__init__(
            i_video=In(stream.Signature(video_payload(build.video_bits))),
            **({"o_homographies": Out(stream.Signature(WordPayload))} if config.estimator else {}),
        )

    @property
    def closing_clocks(self) -> int:
        """See `hdl.front_end.FrontEnd`."""
        return self._front_end.closing_clocks

    def elaborate(self, platform: object) -> Module:
        """The data path and the status, which ``clear`` resets; registers and outputs, which it does not."""
        m = Module()
        registers = self.registers
        # 1 at first, so that the design starts in reset even where nobody asserts it.
        reset = Signal(init=1)
        clear = Signal(init=1)
        m.d.sync += [reset.eq(self.i_reset), clear.eq(self.i_reset | registers.o_clear)]
        m.submodules.registers = ResetInserter(reset)(registers)
        m.submodules.data_path = ResetInserter(clear)(self._data_path())
        m.submodules.outputs = ResetInserter(reset)(self._outputs(clear))
        m.submodules.status = ResetInserter(clear)(self._status())
        if self._estimator is not None:
            m.submodules.estimator = ResetInserter(reset)(self._estimator)
            m.submodules.estimator_status = ResetInserter(clear)(self._estimator_status(self._estimator))
            m.d.comb += self._estimator.i_clear.eq(clear)
        wiring.connect(m, wiring.flipped(self.control), registers.bus)
        m.d.comb += [
            self.o_interrupt.eq(registers.o_interrupt),
            *(self._front_end.settings[each.name].eq(getattr(registers, f"o_{each.name}")) for each in FRONT_END),
            # The shell of a camera build discards packets itself and needs to see them.
            self._feature_gate.i_enable.eq(registers.o_features_enable | self._has_shell),
            self._match_gate.i_enable.eq(registers.o_matches_enable | self._has_shell),
        ]
        return m

    def _data_path(self) -> Module:
        """Front end and matcher, and the fork of features between the matcher and their output."""
        m = Module()
        m.submodules.front_end = self._front_end
        m.submodules.matcher = self._matcher
        # Gated on both sides: a pixel that waits for `enable` must not be taken.
        video, enable = self._front_end.i_video, self.registers.o_enable
        m.d.comb += [
            video.valid.eq(self.i_video.valid & enable),
            video.payload.eq(self.i_video.payload),
            self.i_video.ready.eq(video.ready & enable),
        ]
        m.submodules.to_matcher = to_matcher = SkidBuffer(shape=WordPayload)
        wiring.connect(m, to_matcher.o, self._matcher.i_features)
        fork(m, self._front_end.o_features, self._feature_gate.i, to_matcher.i)
        if self._estimator is None:
            wiring.connect(m, self._matcher.o_matches, self._match_gate.i)
        else:
            fork(m, self._matcher.o_matches, self._match_gate.i, self._estimator.i_matches)
            m.d.comb += [
                self._matcher.i_estimating.eq(self._estimator.o_estimating),
                self._matcher.i_refused.eq(self._estimator.o_refused),
            ]
        self._matching_settings(m)
        return m

    def _matching_settings(self, m: Module) -> None:
        """Sample what the matcher needs at the start of each frame, and keep it until the frame is matched."""
        registers, front_end, matcher = self.registers, self._front_end, self._matcher
        running = view_signal(MATCHING_SETTINGS, reset_less=True)
        with m.If(front_end.o_frame_starts):
            m.d.sync += [running[name].eq(getattr(registers, f"o_{name}")) for name, _ in MATCHING_SETTINGS]
        m.submodules.ended = ended = fifo.SyncFIFO(width=MATCHING_SETTINGS.size, depth=ENDED_FRAMES)
        sampled = data.View(MATCHING_SETTINGS, ended.r_data)
        m.d.comb += [
            ended.w_en.eq(front_end.o_frame_ends),
            ended.w_data.eq(running),
            ended.r_en.eq(matcher.o_frame_taken),
            matcher.i_keep_above.eq(sampled.keep_above),
            matcher.i_hold_reference.eq(sampled.hold_reference),
            # A frame that started before the request was granted must not repeat it.
            matcher.i_take_reference.eq(sampled.take_reference & registers.o_take_reference),
            registers.i_take_reference.eq(matcher.o_reference_taken),
        ]

    def _outputs(self, clear: Signal) -> Module:
        m = Module()
        m.submodules.features = features = self._feature_gate
        m.submodules.matches = matches = self._match_gate
        wiring.connect(m, features.o, wiring.flipped(self.o_features))
        wiring.connect(m, matches.o, wiring.flipped(self.o_matches))
        m.d.comb += [features.i_clear.eq(clear), matches.i_clear.eq(clear)]
        if not self._has_shell:
            # The shell of a camera build says when its rings have written the last packets.
            closing = features.o_closing | matches.o_closing
            m.d.comb += self.registers.i_clearing.eq(self.registers.o_clear | clear | closing)
        return m

    def _status(self) -> Module:
        """Connect the blocks to the registers; events and counters change when a packet has left."""
        m = Module()
        registers, features, matches = self.registers, self._feature_gate, self._match_gate
        frame_bad = features.o_done & ~features.o_status.good
        m.d.comb += [
            registers.i_video_waiting.eq(self.i_video.valid & ~self.i_video.ready),
            registers.i_features_waiting.eq(self.o_features.valid & ~self.o_features.ready),
            registers.i_matches_waiting.eq(self.o_matches.valid & ~self.o_matches.ready),
            registers.i_frame_done.eq(features.o_done),
            registers.i_matches_done.eq(matches.o_done),
            registers.i_frame_bad.eq(frame_bad),
        ]
        with m.If(features.o_done):
            m.d.sync += [
                registers.i_frames.eq(registers.i_frames + 1),
                registers.i_last_features.eq(features.o_status.features),
                registers.i_last_threshold.eq(features.o_status.threshold),
                registers.i_last_cycles.eq(features.o_status.cycles),
            ]
        with m.If(frame_bad):
            m.d.sync += [
                registers.i_bad_frames.eq(registers.i_bad_frames + 1),
                registers.i_causes.eq(features.o_status.causes),
            ]
        with m.If(matches.o_done):
            m.d.sync += [
                registers.i_last_matches.eq(matches.o_status.matches),
                registers.i_last_kept.eq(matches.o_status.kept),
            ]
        return m

    def _estimator_status(self, estimator: RecordEstimator) -> Module:
        m = Module()
        registers, o = self.registers, self.o_homographies
        wiring.connect(m, estimator.o, wiring.flipped(o))
        m.d.comb += [
            estimator.i_enable.eq(registers.o_homographies_enable | self._has_shell),
            *(estimator.i_settings[each.name].eq(getattr(registers, f"o_{each.name}")) for each in ESTIMATION),
            registers.i_homographies_waiting.eq(o.valid & ~o.ready),
            registers.i_homography_done.eq(o.valid & o.ready & o.payload.last),
        ]
        with m.If(estimator.o_drops):
            m.d.sync += registers.i_lost_homographies.eq(registers.i_lost_homographies + 1)
        return m


def longest_packets(build: Build) -> dict[str, int]:
    """Words of the longest packet of each output: a record for every feature, and what ends one that is broken off."""
    capacity = build.config.front_end.max_features + CLOSING_RECORDS
    return {
        output: words * (1 if output == "homographies" else capacity) for output, words in build.record_words.items()
    }


class AcceleratorTop(FlatTop):
    """`Accelerator` with the flat ports of an AMD IP core, in one clock domain.

    Members
    -------
    aclk, aresetn : In(1)
        Clock of everything, and its synchronous reset, active low.
    s_axis_video_*, m_axis_features_*, m_axis_matches_* : AXI4-Stream
    m_axis_homographies_* : AXI4-Stream
        Only where the accelerator estimates homographies.
    s_axi_ctrl_* : AXI4-Lite
    interrupt : Out(1)
        Active high, level.
    """

    def __init__(self, build: Build) -> None:
        self.accelerator = accelerator = Accelerator(build)
        self._reset_n = Signal(name="reset_n")
        video = accelerator.i_video
        pixels = video.payload.data[: build.video_bits]
        super().__init__(
            {
                "aclk": (In(1), ClockSignal()),
                "aresetn": (In(1), self._reset_n),
                **stream_pins("s_axis_video", video, In, tdata=pixels, tuser=video.payload.first),
                **{
                    name: pin
                    for output in build.outputs
                    for name, pin in packet_pins(f"m_axis_{output}", getattr(accelerator, f"o_{output}")).items()
                },
                **bus_pins("s_axi_ctrl", accelerator.control),
                "interrupt": (Out(1), accelerator.o_interrupt),
            }
        )

    def elaborate(self, platform: object) -> Module:
        """Connect ports by name."""
        m = Module()
        # `Accelerator` has its reset as a port.
        m.domains.sync = ClockDomain(reset_less=True)
        m.submodules.accelerator = self.accelerator
        m.d.comb += self.accelerator.i_reset.eq(~self._reset_n)
        self.connect_pins(m)
        return m
