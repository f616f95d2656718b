"""Instances of a vendor's multipliers and memories, where its tools do not infer them with their registers."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

from amaranth import Module, Signal, Value


@runtime_checkable
class Technology(Protocol):
    """The platform of an elaboration for one family of FPGAs: ``to_verilog(component, platform=Ecp5())``.

    Without one, the tools infer multipliers and memories. The latency is the same.
    """

    def multiplier(self, m: Module, *, a: Value, b: Value, loads: tuple[Value, Value, Value], product: Signal) -> None:
        """Add ``product`` = ``a`` × ``b``; ``loads`` enable the operand, multiplier and product registers."""

    def memory(
        self,
        m: Module,
        *,
        depth: int,
        read_address: Value,
        registers: Value,
        read_data: Value,
        write: Value,
        write_address: Value,
        write_data: Value,
    ) -> None:
        """Add a memory that is read in every clock; in the next, ``registers`` passes the word on to ``read_data``.

        A read of the address being written may return anything.
        """
