"""The camera build: from a camera to packets of features, matches and homographies in memory, without software."""

from amaranth import ClockDomain, ClockSignal, Const, Module, ResetInserter, Signal
from amaranth.lib import stream, wiring
from amaranth.lib.cdc import ResetSynchronizer
from amaranth.lib.wiring import In, Out

from hdl.accelerator import Accelerator, longest_packets
from hdl.axi.axi_lite import AXI_LITE
from hdl.axi.axi_read import AXI_READ
from hdl.axi.axi_write import AXI_WRITE
from hdl.axi.flat_ports import FlatTop, bus_pins, stream_pins
from hdl.axi.video_input import VideoPayload
from hdl.build import Build
from hdl.painting.line_reader import SHOWN
from hdl.shell.camera import RESERVE_PX
from hdl.shell.painting import PORTS, Painting
from hdl.shell.shell import Shell

FIFO_WORDS = 512


class CameraAccelerator(wiring.Component):
    """`Accelerator` in a `Shell`, for a build with the shell ``camera``.

    The camera's pixels are in the domain ``camera``, everything else in ``sync``.
    """

    i_reset: In(1)
    """Synchronous reset of everything in ``sync``."""
    i_camera_valid: In(1)
    """In ``camera``, as ``i_camera``."""
    i_camera: In(VideoPayload)
    """AXI4-Stream video (UG934) without ready."""
    features: Out(AXI_WRITE)
    """The ring of features in memory."""
    matches: Out(AXI_WRITE)
    """The ring of matches in memory."""
    homographies: Out(AXI_WRITE)
    """The ring of homographies in memory, a record for every frame; unused without an estimator."""
    frames: Out(AXI_WRITE)
    """The painter's frames on their way into memory; unused without a painter, as the next three."""
    windows: Out(AXI_READ)
    """Parts of these frames."""
    old_tiles: Out(AXI_READ)
    """Tiles of the canvas before a frame."""
    new_tiles: Out(AXI_WRITE)
    """And behind it."""
    pictures: Out(AXI_READ)
    """What is shown of it."""
    o_picture: Out(stream.Signature(SHOWN))
    """The painter's pictures for a display; unused without it, as ``pictures``."""
    control: In(AXI_LITE)
    """`hdl.registers.shell_register_map.list_registers`."""
    o_interrupt: Out(1)

    def __init__(self, build: Build) -> None:
        self.accelerator = accelerator = Accelerator(build)
        self.rings = build.outputs
        self._painting = Painting(registers=accelerator.registers) if build.painter else None
        self.ports = (*self.rings, *(PORTS if build.painter else ()))
        # While a frame that was cut off is closed, the queue holds the next one's pixels; otherwise that one would be
        # cut off, too, and so on for ever. The second reserve is for the clocks that pixels take from the queue on.
        held_px = build.max_width_px + accelerator.closing_clocks + 2 * RESERVE_PX
        self._shell = Shell(
            registers=accelerator.registers,
            record_words=build.record_words,
            max_words=longest_packets(build),
            video_bits=build.video_bits,
            # A power of two, as the Gray counters of the queue need it.
            camera_depth=1 << (held_px - 1).bit_length(),
            fifo_words=FIFO_WORDS,
            painting=self._painting,
        )
        super().__init__()

    def elaborate(self, platform: object) -> Module:
        """Connect the shell around the accelerator."""
        m = Module()
        # One register between the port and all that it resets; high at the start, before any clock.
        reset = Signal(init=1)
        m.d.sync += reset.eq(self.i_reset)
        m.submodules.accelerator = inner = self.accelerator
        m.submodules.shell = ResetInserter(reset)(self._shell)
        shell = self._shell
        wiring.connect(m, shell.o_video, inner.i_video)
        wiring.connect(m, wiring.flipped(self.control), inner.control)
        for ring in self.rings:
            wiring.connect(m, getattr(inner, f"o_{ring}"), getattr(shell, f"i_{ring}"))
            wiring.connect(m, getattr(shell, ring), wiring.flipped(getattr(self, ring)))
        if self._painting is not None:
            for port in PORTS:
                wiring.connect(m, getattr(self._painting, port), wiring.flipped(getattr(self, port)))
            wiring.connect(m, self._painting.o_picture, wiring.flipped(self.o_picture))
        m.d.comb += [
            inner.i_reset.eq(self.i_reset),
            shell.i_camera_valid.eq(self.i_camera_valid),
            shell.i_camera.eq(self.i_camera),
            self.o_interrupt.eq(inner.o_interrupt),
        ]
        return m


class CameraTop(FlatTop):
    """`CameraAccelerator` with two clocks and flat ports, named as AMD names them.

    Members
    -------
    aclk, aresetn : In(1)
        Clock of everything but the camera, and the synchronous reset of everything, active low.
    video_aclk : In(1)
        The camera's pixel clock.
    s_axis_video_* : AXI4-Stream, in ``video_aclk``
        Its TREADY is always 1.
    m_axi_features_*, m_axi_matches_*, m_axi_homographies_* : AXI4, writes only
        The last one only where the accelerator estimates homographies.
    m_axi_frames_*, m_axi_new_tiles_* : AXI4, writes only
        Only with a painter.
    m_axi_windows_*, m_axi_old_tiles_*, m_axi_pictures_* : AXI4, reads only
        Only with a painter.
    m_axis_picture_* : AXI4-Stream video
        Only with a painter; TUSER at the start of a picture, TLAST at the end of a line (UG934).
    s_axi_ctrl_* : AXI4-Lite
    interrupt : Out(1)
        Active high, level.
    """

    def __init__(self, build: Build) -> None:
        self.core = core = CameraAccelerator(build)
        self._reset_n = Signal(name="reset_n")
        camera, shown = core.i_camera, core.o_picture
        colours = {"tdata": shown.payload.data, "tuser": shown.payload.first}
        super().__init__(
            {
                "aclk": (In(1), ClockSignal()),
                "aresetn": (In(1), self._reset_n),
                "video_aclk": (In(1), ClockSignal("camera")),
                "s_axis_video_tdata": (In(build.video_bits), camera.data),
                "s_axis_video_tuser": (In(1), camera.first),
                "s_axis_video_tlast": (In(1), camera.last),
                "s_axis_video_tvalid": (In(1), core.i_camera_valid),
                "s_axis_video_tready": (Out(1), Const(1)),
                **bus_pins("s_axi_ctrl", core.control),
                **{
                    name: pin
                    for port in core.ports
                    for name, pin in bus_pins(f"m_axi_{port}", getattr(core, port)).items()
                },
                **(stream_pins("m_axis_picture", shown, Out, **colours) if build.painter else {}),
                "interrupt": (Out(1), core.o_interrupt),
            }
        )

    def elaborate(self, platform: object) -> Module:
        """Connect ports by name."""
        m = Module()
        # `CameraAccelerator` has its reset as a port. The pixel clock needs one of its own, since it is asynchronous.
        m.domains.sync = ClockDomain(reset_less=True)
        m.domains.camera = ClockDomain()
        m.submodules.camera_reset = ResetSynchronizer(~self._reset_n, domain="camera")
        m.submodules.core = self.core
        m.d.comb += self.core.i_reset.eq(~self._reset_n)
        self.connect_pins(m)
        return m
