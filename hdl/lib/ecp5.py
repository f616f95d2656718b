"""Multipliers and block RAMs of Lattice's ECP5, instantiated with their own registers.

Yosys infers both, but without the registers inside: a structure tensor on an ECP5-85 of speed grade 8 then reaches
half the clock. `ecp5_models.v` beside this file has a model of the multiplier for simulation.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from amaranth import Cat, ClockSignal, Const, Instance, Module, Shape, Signal, Value

if TYPE_CHECKING:
    from hdl.lib.line_memory import LineMemory

MODELS = Path(__file__).with_name("ecp5_models.v")
"""A model of the multiplier, for simulation."""

FACTOR_BITS = 18
WIDTHS = (18, 9, 4, 2, 1)
"""Word widths of a DP16KD; each has twice as many words as the one before, from 1024 to 16384."""
ADDRESS_BITS = 14
PORT_BITS = 18
BYTE_ENABLES = 0b11
"""In 18-bit words the lowest address bits are byte enables instead: write both bytes."""
_BLOCK_MODES = {
    "p_REGMODE_A": "NOREG",
    "p_REGMODE_B": "OUTREG",
    "p_WRITEMODE_A": "NORMAL",
    "p_WRITEMODE_B": "NORMAL",
    "p_RESETMODE": "SYNC",
    "p_GSR": "DISABLED",
}


Loads = tuple[Value | None, Value | None, Value]
"""Enables of a multiplier's operand, multiplier and product registers; None: it has no such register."""


class Ecp5:
    """The platform of an elaboration for the ECP5 family: ``to_verilog(component, platform=Ecp5())``.

    Multipliers become MULT18X18Ds and memories DP16KDs, with the same latency as those that tools infer without it.
    """

    def multiplier(self, m: Module, *, a: Value, b: Value, loads: Loads, product: Signal) -> None:
        """Add ``product`` = ``a`` × ``b``, a MULT18X18D with its input, pipeline and output registers, or some of them.

        Raises
        ------
        ValueError
            For a factor of more than 18 bits.
        """
        factor_bits = max(len(a), len(b))
        if factor_bits > FACTOR_BITS:
            raise ValueError(f"a factor has {factor_bits} bits; a MULT18X18D takes {FACTOR_BITS}")
        product_bits = Signal(2 * FACTOR_BITS)
        # Each register and its clock enable; the primitive has four of these.
        enables = {"INPUTA": 0, "INPUTB": 0, "PIPELINE": 1, "OUTPUT": 2}
        registers = [name for name, load in enables.items() if loads[load] is not None]
        ports: dict[str, object] = {
            **{f"p_REG_{name}_CLK": "CLK0" for name in registers},
            **{f"p_REG_{name}_CE": f"CE{enables[name]}" for name in registers},
            "i_SIGNEDA": Const(a.shape().signed, 1),
            "i_SIGNEDB": Const(b.shape().signed, 1),
            "i_CLK0": ClockSignal(),
            **_bits("i_CLK", Const(0, 4), first=1),
            **_bits("i_CE", Cat(*(Const(1) if load is None else load for load in loads), Const(1))),
            **_bits("i_RST", Const(0, 4)),
            **_bits("i_A", _extend(m, a)),
            **_bits("i_B", _extend(m, b)),
            **_bits("i_C", Const(0, FACTOR_BITS)),
            "i_SOURCEA": Const(0, 1),
            "i_SOURCEB": Const(0, 1),
            **_bits("o_P", product_bits),
        }
        m.submodules.multiplier = Instance("MULT18X18D", **ports)
        m.d.comb += product.eq(product_bits[: len(product)])

    def memory(self, m: Module, memory: LineMemory, *, load: Value) -> None:
        """Add DP16KDs side by side for the width of a word, with output registers; port A writes and port B reads.

        ``load`` passes the word of the last ``memory.i_read`` on to ``memory.o_word``.

        Raises
        ------
        ValueError
            For more words than a DP16KD has.
        """
        if memory.depth > 1 << ADDRESS_BITS:
            raise ValueError(f"the memory has {memory.depth} words; a DP16KD has {1 << ADDRESS_BITS} at most")
        # Addresses of a DP16KD count bits: wider words leave the lowest address bits unused.
        unused = min(ADDRESS_BITS - (memory.depth - 1).bit_length(), len(WIDTHS) - 1)
        width = WIDTHS[-1 - unused]
        low = Const(BYTE_ENABLES if width == PORT_BITS else 0, unused)
        write_address = Cat(low, memory.i_write_address, Const(0, ADDRESS_BITS))[:ADDRESS_BITS]
        read_address = Cat(low, memory.i_read_address, Const(0, ADDRESS_BITS))[:ADDRESS_BITS]
        written, word = Value.cast(memory.i_word), Value.cast(memory.o_word)
        for n, first in enumerate(range(0, len(word), width)):
            data = written[first : first + width]
            read = Signal(PORT_BITS)
            m.d.comb += word[first : first + width].eq(read)
            m.submodules[f"block{n}"] = Instance(
                "DP16KD",
                p_DATA_WIDTH_A=width,
                p_DATA_WIDTH_B=width,
                **_BLOCK_MODES,
                i_CLKA=ClockSignal(),
                i_CLKB=ClockSignal(),
                i_WEA=memory.i_write,
                i_WEB=Const(0, 1),
                i_CEA=Const(1, 1),
                # Only what the output register takes counts, and an enable would be one more long wire. Where a word
                # waits, the port is read when it leaves, too: whether the register needs the port's enable besides its
                # own then makes no difference.
                i_CEB=memory.i_read | load if memory.loads else Const(1, 1),
                i_OCEA=Const(1, 1),
                i_OCEB=load,
                i_RSTA=Const(0, 1),
                i_RSTB=Const(0, 1),
                **_bits("i_CSA", Const(0, 3)),
                **_bits("i_CSB", Const(0, 3)),
                **_bits("i_ADA", write_address),
                **_bits("i_ADB", read_address),
                **_bits("i_DIA", Cat(data, Const(0, PORT_BITS - len(data)))),
                **_bits("i_DIB", Const(0, PORT_BITS)),
                **_bits("o_DOB", read),
            )


def synthesis_commands(top: str) -> str:
    """Yosys's commands that map the design ``top`` to the ECP5; options of the last one may follow."""
    # Yosys 0.70's ABC9 ends without a word on the ring window; the older ABC takes its place.
    run = f"synth_ecp5 -top {top} -run"
    return f"{run} begin:map_luts; abc -lut 4:7; clean; {run} map_cells:"


def _bits(port: str, value: Value, *, first: int = 0) -> dict[str, object]:
    """Ports of a primitive for ``value``: it has one for each bit."""
    return {f"{port}{n}": value[n] for n in range(first, len(value))}


def _extend(m: Module, factor: Value) -> Signal:
    extended = Signal(Shape(FACTOR_BITS, factor.shape().signed), name="factor")
    m.d.comb += extended.eq(factor)
    return extended
