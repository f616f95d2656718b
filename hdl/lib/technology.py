"""Instances of a vendor's multipliers and memories, where its tools do not infer them with their registers."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol, runtime_checkable

from amaranth import Module, Signal, Value

if TYPE_CHECKING:
    from hdl.lib.line_memory import LineMemory


Loads = tuple[Value | None, Value | None, Value]
"""Enables of a multiplier's operand, multiplier and product registers; None: it has no such register."""


@runtime_checkable
class Technology(Protocol):
    """The platform of an elaboration for one family of FPGAs: ``to_verilog(component, platform=Ecp5())``.

    Without one, the tools infer multipliers and memories. The latency is the same.
    """

    factor_bits: int
    """Widest factor of its multiplier, with the sign."""

    def multiplier(self, m: Module, *, a: Value, b: Value, loads: Loads, product: Signal) -> None:
        """Add ``product`` = ``a`` × ``b`` with its registers."""

    def memory(self, m: Module, memory: LineMemory, *, load: Value) -> None:
        """Add a memory between the ports of ``memory``, read at least where ``memory.i_read`` asks for it.

        ``load`` passes the word of the last such read on to ``memory.o_word``. A read of the address being written may
        return anything.
        """
