"""The protocol on the serial port: register accesses and pixels to the accelerator, answers and packets from it."""

import enum
from collections.abc import Sequence

from amaranth import Cat, Const, Module, Mux, Signal, Value
from amaranth.lib import stream
from amaranth.lib.wiring import In, Out

from golden_model.records import WORD_BYTES
from hdl.axi.axi_lite import AXI_LITE
from hdl.axi.video_input import VideoPayload
from hdl.lib.component import Component
from hdl.streams import WordPayload

FORGET_CLOCKS = 1 << 20
"""After a pause of this length inside a command, the next byte begins a new one: 42 ms at 25 MHz."""


class Command(enum.IntEnum):
    """First byte of a command. Two more follow, the lower first: an address, or a number of pixels."""

    READ = ord("R")
    WRITE = ord("W")
    """Four bytes of data follow."""
    PIXELS = ord("P")
    """That number of pixels follows."""
    LAST_PIXELS = ord("L")
    """The same, and the last pixel ends the transfer."""


class Message(enum.IntEnum):
    """First byte of a message from the board."""

    ANSWER = ord("A")
    """To a read or a write: a byte whose bit 7 says that bytes were lost, and four of data."""
    FEATURES = 0x10
    """Eight bytes follow, a word of the packet of features."""
    MATCHES = 0x20
    HOMOGRAPHIES = 0x30
    LAST = 0x01
    """Added to one of the three: the word ends its packet. 0x41 would be `ANSWER`."""


FIELD_BYTES, DATA_BYTES = 2, 4
ANSWER_BYTES = 2 + DATA_BYTES
WORD_MESSAGE_BYTES = 1 + WORD_BYTES
LOST_BIT = 7


class _CommandState:
    """State of the command in progress."""

    def __init__(self) -> None:
        self.kind = Signal(8)
        self.field = Signal(16)
        self.data = Signal(8 * DATA_BYTES)
        self.left = Signal(range(max(FIELD_BYTES, DATA_BYTES) + 1))
        # Clocks without a byte.
        self.idle = Signal(range(FORGET_CLOCKS))
        # Whether the bus has taken the address, and the data of a write.
        self.addressed = Signal()
        self.written = Signal()


class SerialLink(Component):
    """Obeys commands byte by byte, and sends answers and the words of all packets, answers first.

    A byte that begins no command is ignored; an incomplete command is dropped after `FORGET_CLOCKS`. While the
    accelerator accepts no pixel, no command is read.

    Parameters
    ----------
    outputs : sequence of str
        `hdl.build.Build.outputs`; each has an input ``i_*`` here, a stream of `hdl.streams.WordPayload`. Words of
        the first come first.
    """

    i: In(stream.Signature(8))
    """Bytes from the port."""
    o: Out(stream.Signature(8))
    """Bytes to the port."""
    i_lost: In(1)
    """High for a clock when a byte is lost; the next answer reports it."""
    o_video: Out(stream.Signature(VideoPayload))
    """Gray pixels, for an 8-bit input in memory mode."""
    control: Out(AXI_LITE)
    o_has_lost: Out(1)
    """Bytes were lost since the last answer."""

    def __init__(self, outputs: Sequence[str] = ("features", "matches")) -> None:
        self.outputs = tuple(outputs)
        super().__init__(**{f"i_{output}": In(stream.Signature(WordPayload)) for output in self.outputs})

    def elaborate(self, platform: object) -> Module:
        """Connect the receiving and the sending half."""
        m = Module()
        answer = Signal(8 * (ANSWER_BYTES - 1))
        has_answer = Signal()
        answer_sent = self._send(m, has_answer, answer)
        self._obey(m, has_answer, answer)
        with m.If(answer_sent):
            m.d.sync += has_answer.eq(0)
        with m.If(self.i_lost):
            m.d.sync += self.o_has_lost.eq(1)
        with m.Elif(answer_sent):
            m.d.sync += self.o_has_lost.eq(0)
        return m

    def _obey(self, m: Module, has_answer: Signal, answer: Signal) -> None:
        """Receive a command, its address or number, and its data; then carry it out."""
        command, bus, video = _CommandState(), self.control, self.o_video
        m.d.comb += [
            bus.awaddr.eq(command.field),
            bus.araddr.eq(command.field),
            bus.wdata.eq(command.data),
            bus.wstrb.eq(~0),
            # One access at a time, so its response is always welcome.
            bus.bready.eq(1),
            bus.rready.eq(1),
            video.payload.data.eq(self.i.payload),
            video.payload.last.eq((command.kind == Command.LAST_PIXELS) & (command.field == 1)),
        ]
        m.d.sync += [
            command.idle.eq(Mux(self.i.valid, 0, command.idle + 1)),
            command.left.eq(command.left - (self.i.valid & self.i.ready)),
        ]
        with m.FSM(name="command"):
            self._gather(m, command)
            self._pass_pixels(m, command)
            self._access(m, command, has_answer, answer)

    def _gather(self, m: Module, command: _CommandState) -> None:
        """Receive the bytes of a command before its pixels."""
        byte, takes = self.i.payload, self.i.valid & self.i.ready
        ends = takes & (command.left == 1)
        with m.State("COMMAND"):
            m.d.comb += self.i.ready.eq(1)
            m.d.sync += [command.kind.eq(byte), command.left.eq(FIELD_BYTES)]
            m.d.sync += [command.addressed.eq(0), command.written.eq(0)]
            with m.If(takes & Cat(byte == each for each in Command).any()):
                m.next = "FIELD"
        with m.State("FIELD"):
            m.d.comb += self.i.ready.eq(1)
            with m.If(takes):
                m.d.sync += command.field.eq(Cat(command.field[8:], byte))
            with m.If(command.idle.all()):
                m.next = "COMMAND"
            with m.Elif(ends):
                m.d.sync += command.left.eq(DATA_BYTES)
                m.next = "PIXELS"
                with m.If(command.kind == Command.READ):
                    m.next = "READ"
                with m.Elif(command.kind == Command.WRITE):
                    m.next = "DATA"
        with m.State("DATA"):
            m.d.comb += self.i.ready.eq(1)
            with m.If(takes):
                m.d.sync += command.data.eq(Cat(command.data[8:], byte))
            with m.If(command.idle.all()):
                m.next = "COMMAND"
            with m.Elif(ends):
                m.next = "WRITE"

    def _pass_pixels(self, m: Module, command: _CommandState) -> None:
        video, are_left = self.o_video, command.field != 0
        with m.State("PIXELS"):
            m.d.comb += [video.valid.eq(self.i.valid & are_left), self.i.ready.eq(video.ready & are_left)]
            m.d.sync += command.field.eq(command.field - (video.valid & video.ready))
            with m.If(~are_left | command.idle.all()):
                m.next = "COMMAND"

    def _access(self, m: Module, command: _CommandState, has_answer: Signal, answer: Signal) -> None:
        bus = self.control
        with m.State("READ"):
            m.d.comb += bus.arvalid.eq(~command.addressed)
            m.d.sync += command.addressed.eq(command.addressed | bus.arready)
            with m.If(bus.rvalid):
                m.d.sync += [has_answer.eq(1), answer.eq(Cat(Const(0, 8), bus.rdata))]
                m.next = "ANSWER"
        with m.State("WRITE"):
            m.d.comb += [bus.awvalid.eq(~command.addressed), bus.wvalid.eq(~command.written)]
            m.d.sync += [
                command.addressed.eq(command.addressed | bus.awready),
                command.written.eq(command.written | bus.wready),
            ]
            with m.If(bus.bvalid):
                m.d.sync += [has_answer.eq(1), answer.eq(0)]
                m.next = "ANSWER"
        with m.State("ANSWER"), m.If(~has_answer):
            m.next = "COMMAND"

    def _send(self, m: Module, has_answer: Signal, answer: Signal) -> Signal:
        """Send one message after the other; returns a signal that is high when the answer has been taken over."""
        message = Signal(8 * WORD_MESSAGE_BYTES)
        left = Signal(range(WORD_MESSAGE_BYTES + 1))
        taken = Signal()
        free = left == 0
        lost = Cat(Const(0, LOST_BIT), self.o_has_lost, Const(0, len(answer) - LOST_BIT - 1))
        m.d.comb += [self.o.valid.eq(~free), self.o.payload.eq(message[:8])]
        with m.If(self.o.valid & self.o.ready):
            m.d.sync += [message.eq(message >> 8), left.eq(left - 1)]
        with m.If(free & has_answer):
            m.d.comb += taken.eq(1)
            m.d.sync += [message.eq(Cat(Const(Message.ANSWER, 8), answer | lost)), left.eq(ANSWER_BYTES)]
        # Answers first, since the host waits for them before it sends more.
        earlier: Value = has_answer
        for output in self.outputs:
            port, tag = getattr(self, f"i_{output}"), Message[output.upper()]
            m.d.comb += port.ready.eq(free & ~earlier)
            with m.If(port.valid & port.ready):
                first = Const(tag, 8) | port.payload.last
                m.d.sync += [message.eq(Cat(first[:8], port.payload.data)), left.eq(WORD_MESSAGE_BYTES)]
            earlier |= port.valid
        return taken
