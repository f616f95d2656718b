"""The accelerator as an IP-XACT component (IEEE 1685-2014), and its ports as bus interfaces for AMD's tools."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

from golden_model.version import VERSION
from hdl.blocks.export import CORE_LIBRARY, CORE_VENDOR
from hdl.blocks.testbench import Port
from hdl.export.register_docs import COMMON, NAME, XML_ACCESS
from hdl.registers.register_map import REGISTERS, Register
from hdl.templates import render

NAMESPACE = "http://www.accellera.org/XMLSchema/IPXACT/1685-2014"
# Vivado numbers a core by major.minor and keeps a revision beside it (UG1118).
CORE_VERSION, _, CORE_REVISION = VERSION.rpartition(".")
VLNV = f"{CORE_VENDOR}:{CORE_LIBRARY}:{NAME}:{CORE_VERSION}"
"""How Vivado names the accelerator."""
CLOCK, RESET, INTERRUPT = "aclk", "aresetn", "interrupt"
BUS_VENDOR, BUS_VERSION = "xilinx.com", "1.0"
"""Vendor and version of AMD's bus definitions; IP-XACT names them, too, because Vivado knows no others."""
_LIBRARY = {"axis": ("interface", "axis"), "axi": ("interface", "aximm")}
_SIGNALS = {CLOCK: ("clock", "CLK"), RESET: ("reset", "RST"), INTERRUPT: ("interrupt", "INTERRUPT")}
"""AMD's definition of each signal, and the name of the signal in it."""


@dataclass(frozen=True)
class BusInterface:
    """A bus of a core."""

    name: str
    """Name of the interface; for a bus, also the prefix of its ports."""
    bus_library: str
    bus: str
    """AMD's definition: ``interface`` ``axis`` or ``aximm``, ``signal`` ``clock`` and so on."""
    manager: bool
    """Whether the core starts transfers, or drives the signal."""
    ports: dict[str, str]
    """For each signal of the bus, the core's port."""
    parameters: dict[str, str] = field(default_factory=dict)
    """FREQ_HZ is omitted: the clock is that of the design around the core."""


def bus_interfaces(ports: Iterable[str]) -> list[BusInterface]:
    """Group the ports of a core, named as AMD names them: ``s_axis_...``, ``m_axis_...``, ``s_axi_...``."""
    buses: dict[str, dict[str, str]] = {}
    for port in ports:
        # `m_axis_features_tdata` is the signal TDATA of the bus `m_axis_features`.
        if port not in _SIGNALS:
            prefix, _, name = port.rpartition("_")
            buses.setdefault(prefix, {})[name.upper()] = port
    interfaces = [
        BusInterface(prefix, *_LIBRARY[prefix.split("_")[1]], prefix.startswith("m"), mapped)
        for prefix, mapped in buses.items()
    ]
    parameters = {
        CLOCK: {"ASSOCIATED_BUSIF": ":".join(buses), "ASSOCIATED_RESET": RESET},
        RESET: {"POLARITY": "ACTIVE_LOW"},
        INTERRUPT: {"SENSITIVITY": "LEVEL_HIGH"},
    }
    return interfaces + [
        BusInterface(port, "signal", bus, port == INTERRUPT, {signal: port}, parameters[port])
        for port, (bus, signal) in _SIGNALS.items()
    ]


def vivado_attributes(ports: Iterable[str]) -> dict[str, dict[str, str]]:
    """Attributes X_INTERFACE_INFO and X_INTERFACE_PARAMETER of each port (UG994): Vivado infers the buses from them."""
    attributes: dict[str, dict[str, str]] = {}
    for interface in bus_interfaces(ports):
        kind = f"{BUS_VENDOR}:{interface.bus_library}:{interface.bus}:{BUS_VERSION}"
        for name, port in interface.ports.items():
            attributes[port] = {"X_INTERFACE_INFO": f"{kind} {interface.name} {name}"}
            if interface.parameters:
                # XIL_INTERFACENAME has to come first (UG994).
                texts = (f"{name} {value}" for name, value in interface.parameters.items())
                attributes[port]["X_INTERFACE_PARAMETER"] = ", ".join((f"XIL_INTERFACENAME {interface.name}", *texts))
    return attributes


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
