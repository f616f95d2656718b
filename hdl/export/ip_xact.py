"""The accelerator as an IP-XACT component (IEEE 1685-2014): buses, registers, ports and the Verilog file."""

from collections.abc import Mapping, Sequence

from golden_model.version import VERSION
from hdl.blocks.export import CORE_LIBRARY, CORE_VENDOR
from hdl.blocks.testbench import Port
from hdl.export.bus_interfaces import BUS_VENDOR, BUS_VERSION, bus_interfaces
from hdl.export.register_docs import COMMON, NAME, XML_ACCESS
from hdl.registers.register_map import REGISTERS, Register
from hdl.templates import render

NAMESPACE = "http://www.accellera.org/XMLSchema/IPXACT/1685-2014"
# Vivado numbers a core by major.minor and keeps a revision beside it (UG1118).
CORE_VERSION, _, CORE_REVISION = VERSION.rpartition(".")
VLNV = f"{CORE_VENDOR}:{CORE_LIBRARY}:{NAME}:{CORE_VERSION}"
"""How Vivado names the accelerator."""


def component(ports: Mapping[str, Port], file: str, registers: Sequence[Register] = REGISTERS) -> str:
    """Describe the accelerator's Verilog as an IP-XACT component; ``file`` is its path, from the XML file."""
    return render(
        "ip_xact.xml",
        vendor=CORE_VENDOR,
        library=CORE_LIBRARY,
        namespace=NAMESPACE,
        bus_vendor=BUS_VENDOR,
        bus_version=BUS_VERSION,
        interfaces=bus_interfaces(ports),
        registers=registers,
        xml_access=XML_ACCESS,
        ports=ports,
        file=file,
        **COMMON,
    )
