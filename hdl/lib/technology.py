"""What a vendor's tools do not infer: multipliers and memories with registers of their own, as instances."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

from amaranth import Module, Signal, Value


@runtime_checkable
class Technology(Protocol):
    """The platform of an elaboration for one family of FPGAs: ``to_verilog(component, platform=Ecp5())``.

    Without one, the blocks describe their registers and the tools infer the rest. Both have the same latency.
    """

    def multiplier(self, m: Module, *, a: Value, b: Value, loads: tuple[Value, Value, Value], product: Signal) -> None:
        """``product`` = ``a`` × ``b``; ``loads`` let the operand, multiplier and product registers take new values."""

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
        """A memory that is read in every clock; in the next one ``registers`` passes the word on to ``read_data``.

        A read of the address that is being written may return anything.
        """
