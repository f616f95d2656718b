"""A memory with an output register, for lines of pixels and for features."""

from amaranth import Module, ShapeLike, Signal
from amaranth.lib import memory
from amaranth.lib.wiring import In, Out

from hdl.lib.component import Component
from hdl.lib.delay import delayed, port_register
from hdl.lib.ecp5 import Ecp5


class LineMemory(Component):
    """A memory with a port to read and one to write, and a register behind the read port.

    The output of a block RAM is slow, hence the register, which tools may take from the block RAM itself. Where they
    do not, `Ecp5` instantiates its block RAM. Reading a word that is being written may return anything.

    Parameters
    ----------
    shape : ShapeLike
        Shape of a word.
    depth : int
        Number of words.
    loads : bool
        A word waits in the memory until ``i_load`` moves it into the output register, once for each ``i_read``.
    """

    i_read: In(1)
    i_read_address: Signal
    i_load: Signal
    """Only with ``loads``: the output register takes the word of the last ``i_read`` before this clock."""
    o_word: Signal
    """The word read last."""
    i_write: In(1)
    i_write_address: Signal
    i_word: Signal

    latency_cycles = 2
    """From ``i_read`` to ``o_word``; with ``loads`` at the earliest."""

    def __init__(self, *, shape: ShapeLike, depth: int, loads: bool = False) -> None:
        self.shape = shape
        self.depth = depth
        self.loads = loads
        super().__init__(
            i_read_address=In(range(depth)),
            **({"i_load": In(1)} if loads else {}),
            o_word=Out(shape),
            i_write_address=In(range(depth)),
            i_word=In(shape),
        )

    def elaborate(self, platform: object) -> Module:
        """Add the memory and its output register, inferred or in the platform's block RAMs."""
        m = Module()
        load = self.i_load if self.loads else delayed(m, self.i_read, 1, reset_less=False)
        if isinstance(platform, Ecp5):
            platform.memory(m, self, load=load)
            return m
        words: memory.Memory
        m.submodules.memory = words = memory.Memory(shape=self.shape, depth=self.depth, init=[])
        read = words.read_port()
        write = words.write_port()
        word = port_register(m, self.o_word)
        with m.If(load):
            m.d.sync += word.eq(read.data)
        m.d.comb += [
            read.addr.eq(self.i_read_address),
            read.en.eq(self.i_read),
            write.addr.eq(self.i_write_address),
            write.en.eq(self.i_write),
            write.data.eq(self.i_word),
        ]
        return m
