"""The IP-XACT component tells every port, register and field; what it does not know, it leaves out."""

import functools
import xml.etree.ElementTree as ET

from amaranth.hdl import Fragment

from hdl.accelerator import AcceleratorTop
from hdl.blocks.export import module_ports
from hdl.blocks.testbench import Port
from hdl.build import BUILDS
from hdl.export.ip_xact import NAMESPACE, bus_interfaces, component, vivado_attributes
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


def test_every_port_has_its_width_and_belongs_to_one_bus() -> None:
    assert sorted(str(found.text) for found in told().iterfind(".//x:physicalPort/x:name", NAMES)) == sorted(ports())
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


BUS_PORTS = [
    "aclk", "aresetn", "interrupt", "s_axis_video_tdata", "s_axis_video_tvalid", "m_axi_ring_awaddr",
    "s_axi_ctrl_rdata",
]  # fmt: skip


def test_a_bus_has_the_ports_of_its_prefix_and_its_direction_and_the_clock_names_all_buses() -> None:
    found = {each.name: each for each in bus_interfaces(BUS_PORTS)}
    video, ring, control = found["s_axis_video"], found["m_axi_ring"], found["s_axi_ctrl"]
    assert (video.bus, video.manager) == ("axis", False)
    assert video.ports == {"TDATA": "s_axis_video_tdata", "TVALID": "s_axis_video_tvalid"}
    assert (ring.bus, ring.manager, ring.ports) == ("aximm", True, {"AWADDR": "m_axi_ring_awaddr"})
    assert (control.bus, control.manager) == ("aximm", False)
    assert found["aclk"].parameters == {
        "ASSOCIATED_BUSIF": "s_axis_video:m_axi_ring:s_axi_ctrl",
        "ASSOCIATED_RESET": "aresetn",
    }
    assert found["aresetn"].parameters == {"POLARITY": "ACTIVE_LOW"}
    assert [each.name for each in found.values() if each.manager] == ["m_axi_ring", "interrupt"]
    attributes = vivado_attributes(BUS_PORTS)
    assert sorted(attributes) == sorted(BUS_PORTS)
    assert attributes["aresetn"]["X_INTERFACE_PARAMETER"] == "XIL_INTERFACENAME aresetn, POLARITY ACTIVE_LOW"
