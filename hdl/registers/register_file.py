"""The register file: the hardware of a register map, behind AXI4-Lite."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from amaranth import Cat, Const, Module, Mux, Value
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out

from hdl.axi.axi_lite import AXI_LITE, AxiLiteSubordinate
from hdl.registers.register_map import REGISTERS, Access, Field, Register, fields

_FROM_HARDWARE = (Access.STATUS, Access.EVENT, Access.REQUEST)
_TO_HARDWARE = (Access.SETTING, Access.EVENT, Access.REQUEST, Access.COMMAND)


class RegisterFile(wiring.Component):
    """Gives software the registers, and hardware a port for each of their fields.

    An unknown address reads 0, and a write to it or to a register without a writable field has no effect. Byte strobes
    are respected; the two lowest address bits are ignored.

    Parameters
    ----------
    constants : mapping of str to int
        Value of every constant field (`hdl.registers.register_map.built_constants`).
    registers : sequence of Register
        The map.

    Raises
    ------
    ValueError
        For a constant that is larger than its field.

    Members
    -------
    bus : In(AXI_LITE)
    i_<field> : In
        The value of a STATUS field; a pulse that sets an EVENT; a pulse that acknowledges a REQUEST.
    o_<field> : Out
        The value of a SETTING; the state of an EVENT; a pending REQUEST; a one-clock pulse for a COMMAND.
    o_interrupt : Out(1)
        High while an event and its mask are set.
    """

    if TYPE_CHECKING:
        # The map makes the ports; a type checker cannot know their names.
        def __getattr__(self, name: str) -> Any: ...

    def __init__(self, *, constants: Mapping[str, int], registers: Sequence[Register] = REGISTERS) -> None:
        self.constants = dict(constants)
        self.registers = tuple(registers)
        for field in self._fields(Access.CONSTANT):
            value, largest = self.constants[field.name], field.mask >> field.low
            if value > largest:
                raise ValueError(f"{field.name} is {value}; its register holds at most {largest}")
        out: Any = Out  # amaranth-stubs still call init by its old name, reset.
        super().__init__(
            {
                "bus": In(AXI_LITE),
                **{f"i_{field.name}": In(field.bits) for field in self._fields(*_FROM_HARDWARE)},
                **{f"o_{field.name}": out(field.bits, init=field.init) for field in self._fields(*_TO_HARDWARE)},
                "o_interrupt": Out(1),
            }
        )

    def elaborate(self, platform: object) -> Module:
        """Build the fields, the answers to writes and reads, and the interrupt."""
        m = Module()
        m.submodules.bus = bus = AxiLiteSubordinate()
        wiring.connect(m, wiring.flipped(self.bus), bus.bus)
        # A mask with a bit for each bit of data.
        strobes = Cat(*(strobe.replicate(8) for strobe in bus.o_strobe))
        for register in self.registers:
            writes = bus.o_write & (bus.o_write_word == register.offset // 4)
            for field in register.fields:
                bits = slice(field.low, field.low + field.bits)
                self._update(m, field, writes, bus.o_data[bits], strobes[bits])
        with m.Switch(bus.o_read_word):
            for register in self.registers:
                with m.Case(register.offset // 4):
                    m.d.comb += bus.i_data.eq(self._word(register))
        events = self._fields(Access.EVENT)
        masked = [getattr(self, f"o_{event.name}") & getattr(self, f"o_{event.name}_mask") for event in events]
        m.d.comb += self.o_interrupt.eq(Cat(masked).any())
        return m

    def _fields(self, *accesses: Access) -> Iterator[Field]:
        return fields(*accesses, registers=self.registers)

    def _update(self, m: Module, field: Field, writes: Value, data: Value, strobe: Value) -> None:
        """Set the next value of a field."""
        if field.access not in _TO_HARDWARE:
            return
        value = getattr(self, f"o_{field.name}")
        ones = Mux(writes, data & strobe, 0)
        match field.access:
            case Access.SETTING:
                with m.If(writes):
                    m.d.sync += value.eq((value & ~strobe) | (data & strobe))
            case Access.COMMAND:
                m.d.sync += value.eq(ones)
            # Setting wins over clearing, so that nothing is lost when a write and the hardware act in the same clock.
            case Access.REQUEST:
                acknowledge = getattr(self, f"i_{field.name}")
                m.d.sync += value.eq((value & ~acknowledge) | ones)
            case Access.EVENT:
                event = getattr(self, f"i_{field.name}")
                m.d.sync += value.eq((value & ~ones) | event)

    def _word(self, register: Register) -> Value:
        """The word that a read returns, with 0 in unused bits."""
        parts: list[Value] = []
        # Fields are declared in the order in which they are explained, not always from bit 0 on.
        for field in sorted(register.fields, key=lambda field: field.low):
            gap = field.low - len(Cat(parts))
            parts += [Const(0, gap), self._value(field)]
        return Cat(parts)

    def _value(self, field: Field) -> Value:
        match field.access:
            case Access.CONSTANT:
                return Const(self.constants[field.name], field.bits)
            case Access.COMMAND:
                return Const(0, field.bits)
        value: Value = getattr(self, f"{'i' if field.access is Access.STATUS else 'o'}_{field.name}")
        return value
