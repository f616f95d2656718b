"""The top for the ULX3S board (ECP5-85): frames over its USB serial port, records back."""

from amaranth import Cat, ClockDomain, ClockSignal, Module, ResetInserter, Signal
from amaranth.lib import fifo, wiring
from amaranth.lib.wiring import In, Out

from hdl.accelerator import Accelerator
from hdl.build import Build
from hdl.serial.link import SerialLink
from hdl.serial.uart import UartReceiver, UartTransmitter

CLOCK_HZ = 25_000_000
"""The board's oscillator; no PLL is needed, since the port is far slower than the accelerator."""
BAUD = 1_000_000
CLOCKS_PER_BIT = CLOCK_HZ // BAUD
COMMAND_SPACE = 64
"""Bytes of the queue besides a frame, for the commands around it."""
RESET_CLOCKS = 16
LEDS = 8


class Ulx3s(wiring.Component):
    """The accelerator of a build with the shell ``serial``, behind the two pins of a serial port.

    Everything runs at the board's 25 MHz. The port has no flow control, so a queue holds a whole frame: the host may
    send one frame, and has to receive its packets before it sends the next.
    """

    clk_25mhz: In(1)
    btn_fire1: In(1)
    """Resets everything while pressed (high)."""
    ftdi_txd: In(1)
    """Bytes from the host; named, as its counterpart, from the side of the board's USB chip."""
    ftdi_rxd: Out(1)
    """Bytes to the host."""
    led: Out(LEDS)
    """From the lowest: pixels are enabled, bytes were lost, features wait, matches wait."""
    wifi_gpio0: Out(1)
    """Constantly high."""

    def __init__(self, build: Build) -> None:
        self.accelerator = Accelerator(build)
        super().__init__()

    def elaborate(self, platform: object) -> Module:
        """Connect port, queue, link and accelerator."""
        m = Module()
        # The board has no reset line; the configuration sets `starting`, and the button sets it again.
        m.domains.sync = ClockDomain(reset_less=True)
        pressed = Signal(2)
        starting = Signal(range(RESET_CLOCKS + 1), init=RESET_CLOCKS)
        m.d.sync += [pressed.eq(Cat(self.btn_fire1, pressed)), starting.eq(starting - starting.any())]
        with m.If(pressed[1]):
            m.d.sync += starting.eq(RESET_CLOCKS)
        m.submodules.accelerator = inner = self.accelerator
        receiver = UartReceiver(clocks_per_bit=CLOCKS_PER_BIT)
        transmitter = UartTransmitter(clocks_per_bit=CLOCKS_PER_BIT)
        link = SerialLink(inner.build.outputs)
        # A whole frame, since the port has no flow control and the accelerator may pause.
        depth = inner.build.max_width_px * inner.build.max_height_px + COMMAND_SPACE
        waiting = fifo.SyncFIFOBuffered(width=8, depth=depth)
        parts = {"receiver": receiver, "transmitter": transmitter, "link": link, "waiting": waiting}
        for name, part in parts.items():
            m.submodules[name] = ResetInserter(starting.any())(part)
        wiring.connect(m, link.control, inner.control)
        wiring.connect(m, link.o_video, inner.i_video)
        for output in inner.build.outputs:
            wiring.connect(m, getattr(inner, f"o_{output}"), getattr(link, f"i_{output}"))
        wiring.connect(m, link.o, transmitter.i)
        m.d.comb += [
            ClockSignal().eq(self.clk_25mhz),
            inner.i_reset.eq(starting.any()),
            receiver.i_pin.eq(self.ftdi_txd),
            self.ftdi_rxd.eq(transmitter.o_pin),
            waiting.w_en.eq(receiver.o_valid),
            waiting.w_data.eq(receiver.o_byte),
            link.i_lost.eq(receiver.o_broken | (receiver.o_valid & ~waiting.w_rdy)),
            link.i.valid.eq(waiting.r_rdy),
            link.i.payload.eq(waiting.r_data),
            waiting.r_en.eq(link.i.ready),
            self.led.eq(Cat(inner.registers.o_enable, link.o_has_lost, inner.o_features.valid, inner.o_matches.valid)),
            # At a low level, the board's radio module would take over.
            self.wifi_gpio0.eq(1),
        ]
        return m
