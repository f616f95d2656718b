"""The IP-XACT component tells every port, register and field; what it does not know, it leaves out."""

import functools
import xml.etree.ElementTree as ET

from amaranth.hdl import Fragment

from golden_model.version import VERSION
from hdl.accelerator import AcceleratorTop
from hdl.blocks.export import module_ports
from hdl.blocks.testbench import Port
from hdl.build import BUILDS
from hdl.export.ip_xact import CORE_REVISION, CORE_VERSION, NAMESPACE, VLNV, component
from hdl.registers.register_map import REGISTERS, Access, fields

NAMES = {"x": NAMESPACE}


@functools.cache
def ports() -> dict[str, Port]:
    top = AcceleratorTop(BUILDS["tiny"])
    # Amaranth warns of a component that nothing elaborates.
    Fragment.get(top, None)
    return module_ports(top)


@functools.cache
def told() -> ET.Element:
    return ET.fromstring(component(ports(), "rtl/skymosaic.v"))


def names(path: str) -> list[str]:
    return [str(found.text) for found in told().iterfind(path, NAMES)]


def test_every_port_has_its_width_and_belongs_to_one_bus() -> None:
    assert sorted(names(".//x:model/x:ports/x:port/x:name")) == sorted(ports())
    assert sorted(names(".//x:physicalPort/x:name")) == sorted(ports())
    widths = {
        port.findtext("x:name", "", NAMES): int(port.findtext(".//x:left", "0", NAMES)) + 1
        for port in told().iterfind(".//x:model/x:ports/x:port", NAMES)
    }
    assert widths == {name: port.bits for name, port in ports().items()}


def test_every_register_has_its_fields() -> None:
    found = {
        (register.findtext("x:name", None, NAMES), field.findtext("x:name", None, NAMES))
        for register in told().iterfind(".//x:register", NAMES)
        for field in register.iterfind("x:field", NAMES)
    }
    assert found == {(register.name, field.name) for register in REGISTERS for field in register.fields}


def test_no_constant_is_said_to_be_0() -> None:
    without_reset = {
        field.findtext("x:name", None, NAMES)
        for field in told().iterfind(".//x:field", NAMES)
        if field.find("x:resets", NAMES) is None
    }
    assert without_reset == {field.name for field in fields(Access.CONSTANT)}


def test_the_file_and_the_version_are_those_of_the_export() -> None:
    assert names(".//x:file/x:name") == ["rtl/skymosaic.v"]
    assert f"{CORE_VERSION}.{CORE_REVISION}" == VERSION
    assert VLNV.endswith(f":skymosaic:{CORE_VERSION}")
