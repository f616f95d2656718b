"""The accelerator as an IP-XACT component (IEEE 1685-2014): buses, registers, ports and the Verilog file."""

import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence

from golden_model.version import VERSION
from hdl.axi.axi_lite import ADDRESS_BITS
from hdl.blocks.export import CORE_LIBRARY, CORE_VENDOR
from hdl.blocks.testbench import Port
from hdl.export.bus_interfaces import BUS_VENDOR, BUS_VERSION, BusInterface, bus_interfaces
from hdl.export.register_docs import NAME, XML_ACCESS
from hdl.registers.register_map import REGISTER_BITS, REGISTERS, Access, Register

NAMESPACE = "http://www.accellera.org/XMLSchema/IPXACT/1685-2014"
MEMORY_MAP = "registers"
# Vivado numbers a core by major.minor and keeps a revision beside it (UG1118).
CORE_VERSION, _, CORE_REVISION = VERSION.rpartition(".")
VLNV = f"{CORE_VENDOR}:{CORE_LIBRARY}:{NAME}:{CORE_VERSION}"
"""How Vivado names the accelerator."""


def component(name: str, ports: Mapping[str, Port], file: str, registers: Sequence[Register] = REGISTERS) -> str:
    """Describe a Verilog module as an IP-XACT component.

    Parameters
    ----------
    name : str
        Name of the Verilog module.
    ports : mapping of str to Port
    file : str
        Path of the Verilog, from the XML file.
    registers : sequence of Register

    Returns
    -------
    str
        The XML file.
    """
    root = ET.Element("ipxact:component", {"xmlns:ipxact": NAMESPACE})
    # The schema prescribes the order of all elements.
    _texts(root, vendor=CORE_VENDOR, library=CORE_LIBRARY, name=name, version=VERSION)
    buses = _child(root, "busInterfaces")
    for interface in bus_interfaces(ports):
        _bus(buses, interface)
    block = _child(_child(root, "memoryMaps"), "memoryMap")
    _texts(block, name=MEMORY_MAP)
    addresses = _child(block, "addressBlock")
    _texts(addresses, name="control", baseAddress="0", range=str(1 << ADDRESS_BITS), width=str(REGISTER_BITS))
    for register in registers:
        _register(addresses, register)
    model = _child(root, "model")
    view = _child(_child(model, "views"), "view")
    _texts(view, name="rtl", componentInstantiationRef="verilog")
    instantiation = _child(_child(model, "instantiations"), "componentInstantiation")
    _texts(instantiation, name="verilog", language="Verilog", moduleName=name)
    _texts(_child(instantiation, "fileSetRef"), localName="rtl")
    listed = _child(model, "ports")
    for port_name, port in ports.items():
        _port(listed, port_name, port)
    files = _child(_child(root, "fileSets"), "fileSet")
    _texts(files, name="rtl")
    _texts(_child(files, "file"), name=file, fileType="verilogSource")
    ET.indent(root)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + ET.tostring(root, encoding="unicode") + "\n"


def _bus(parent: ET.Element, interface: BusInterface) -> None:
    element = _child(parent, "busInterface")
    _texts(element, name=interface.name)
    identity = {"vendor": BUS_VENDOR, "library": interface.bus_library, "version": BUS_VERSION}
    _child(element, "busType", **identity, name=interface.bus)
    abstraction = _child(_child(element, "abstractionTypes"), "abstractionType")
    _child(abstraction, "abstractionRef", **identity, name=f"{interface.bus}_rtl")
    maps = _child(abstraction, "portMaps")
    for logical, physical in interface.ports.items():
        mapped = _child(maps, "portMap")
        _texts(_child(mapped, "logicalPort"), name=logical)
        _texts(_child(mapped, "physicalPort"), name=physical)
    mode = _child(element, "master" if interface.manager else "slave")
    if interface.bus == "aximm" and not interface.manager:
        _child(mode, "memoryMapRef", memoryMapRef=MEMORY_MAP)
    if interface.parameters:
        parameters = _child(element, "parameters")
        for name, value in interface.parameters.items():
            _texts(_child(parameters, "parameter"), name=name, value=value)


def _register(parent: ET.Element, register: Register) -> None:
    element = _child(parent, "register")
    _texts(
        element,
        name=register.name,
        description=register.description,
        addressOffset=f"'h{register.offset:X}",
        size=str(REGISTER_BITS),
    )
    for field in register.fields:
        described = _child(element, "field")
        _texts(described, name=field.name, description=field.description, bitOffset=str(field.low))
        # Between bitOffset and bitWidth, again by the schema; what a build decides has no value here.
        if field.access is not Access.CONSTANT:
            _texts(_child(_child(described, "resets"), "reset"), value=str(field.init))
        _texts(described, bitWidth=str(field.bits), access=XML_ACCESS[field.access])
        # Software clears an event by writing 1.
        if field.access is Access.EVENT:
            _texts(described, modifiedWriteValue="oneToClear")


def _port(parent: ET.Element, name: str, port: Port) -> None:
    element = _child(parent, "port")
    _texts(element, name=name)
    wire = _child(element, "wire")
    _texts(wire, direction="in" if port.is_input else "out")
    if port.bits > 1:
        _texts(_child(_child(wire, "vectors"), "vector"), left=str(port.bits - 1), right="0")


def _child(parent: ET.Element, tag: str, **attributes: str) -> ET.Element:
    return ET.SubElement(parent, f"ipxact:{tag}", attributes)


def _texts(parent: ET.Element, **texts: str) -> None:
    for name, text in texts.items():
        _child(parent, name).text = text
