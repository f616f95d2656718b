import dataclasses
import enum

import pytest

from golden_model.config import EstimatorConfig
from hdl.build import BUILDS, Build
from hdl.registers.painter_register_map import PAINTER_REGISTERS, PainterFault
from hdl.registers.register_map import ESTIMATOR_REGISTERS, REGISTERS
from hdl.registers.shell_register_map import (
    ALL_REGISTERS,
    HOMOGRAPHY_RING,
    SHELL_REGISTERS,
    Refusal,
    RingFault,
    list_registers,
)
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


@pytest.mark.parametrize("shell", ["streams", "serial", "camera"])
@pytest.mark.parametrize("estimates", [False, True])
def test_a_build_has_the_registers_of_its_parts(shell: str, estimates: bool) -> None:
    usual = {"streams": Build(), "serial": BUILDS["ulx3s"], "camera": BUILDS["camera"]}[shell]
    config = dataclasses.replace(usual.config, estimator=EstimatorConfig() if estimates else None)
    build = dataclasses.replace(usual, config=config)
    found = list_registers(build)
    expected = [*REGISTERS]
    expected += ESTIMATOR_REGISTERS if estimates else ()
    expected += SHELL_REGISTERS if shell == "camera" else ()
    expected += HOMOGRAPHY_RING if shell == "camera" and estimates else ()
    assert list(found) == expected
    if shell == "camera" and estimates:
        expected += PAINTER_REGISTERS
        assert list(list_registers(dataclasses.replace(build, painter=True))) == expected
    assert {*expected} <= {*ALL_REGISTERS}


def test_the_faults_of_each_ring_are_those_of_one() -> None:
    for ring, shift in (("FEATURES", 0), ("MATCHES", 3)):
        assert [Refusal[f"{ring}_{fault.name}"] for fault in RingFault] == [fault << shift for fault in RingFault]


def test_every_ring_has_the_same_registers() -> None:
    shapes = []
    for ring in ("features", "matches", "homographies"):
        names = f"{ring.upper()}_"
        registers = [r for r in ALL_REGISTERS if r.name.startswith(names) and r.name != "HOMOGRAPHIES_STATUS"]
        first = registers[0].offset
        shapes.append(
            [
                (r.name.removeprefix(names), r.offset - first, [(f.low, f.bits, f.access) for f in r.fields])
                for r in registers
            ]
        )
    assert shapes[0] == shapes[1] == shapes[2]
    assert len(shapes[0]) == 6
