import enum

import pytest

from hdl.registers.painter_register_map import PainterFault
from hdl.registers.shell_register_map import ALL_REGISTERS, Refusal, RingFault
from hdl.shell.slot import HeaderFlag


def test_names_and_offsets_are_unique_and_fields_do_not_overlap() -> None:
    names = [field.name for register in ALL_REGISTERS for field in register.fields]
    assert len(set(names)) == len(names)
    assert [r.offset for r in ALL_REGISTERS] == sorted({r.offset for r in ALL_REGISTERS})
    for register in ALL_REGISTERS:
        assert sum(field.mask for field in register.fields) == sum({f.mask for f in register.fields})
        assert sum(field.bits for field in register.fields) == sum(f.mask for f in register.fields).bit_count()
        assert all(field.low + field.bits <= 32 for field in register.fields)


@pytest.mark.parametrize("flags", [HeaderFlag, PainterFault, Refusal, RingFault])
def test_each_fault_has_a_bit_of_its_own_from_the_lowest_on(flags: type[enum.IntFlag]) -> None:
    """What model and hardware share is no check of either: hosts of earlier boards read these."""
    assert [fault.value for fault in flags.__members__.values()] == [1 << bit for bit in range(len(flags.__members__))]
