"""The register map as documentation and for tools: Markdown, CMSIS-SVD, a C header."""

import xml.etree.ElementTree as ET
from collections.abc import Sequence

from golden_model.version import VERSION
from hdl.axi.axi_lite import ADDRESS_BITS
from hdl.registers.live_register_map import ALL_REGISTERS, HOMOGRAPHY_RING_OFFSET, SHELL_OFFSET
from hdl.registers.register_map import ESTIMATOR_OFFSET, REGISTER_BITS, REGISTERS, Access, Field, Register

NAME = "skymosaic"
XML_ACCESS = {
    Access.CONSTANT: "read-only",
    Access.STATUS: "read-only",
    Access.SETTING: "read-write",
    Access.REQUEST: "read-write",
    Access.EVENT: "read-write",
    Access.COMMAND: "write-only",
}
"""The access of a field in the words of CMSIS-SVD and IP-XACT."""


def markdown(registers: Sequence[Register] = ALL_REGISTERS) -> str:
    """The register map as a Markdown page; `docs/reference/register_map.md` is that of all builds."""
    lines = [
        "# Register map",
        "",
        f"Version {VERSION}. AXI4-Lite, {REGISTER_BITS}-bit registers, {1 << ADDRESS_BITS} bytes. "
        "An access to another address, or a write to a register that has no field to write, is answered with SLVERR. "
        "Bits that are not listed read 0. Generated from `hdl/registers/register_map.py` and "
        "`hdl/registers/live_register_map.py`.",
        "",
    ]
    if registers[-1].offset >= ESTIMATOR_OFFSET:
        lines += [
            f"Registers from 0x{ESTIMATOR_OFFSET:X} on exist in builds with an estimator only (`--homography`), those "
            f"from 0x{SHELL_OFFSET:X} on in live builds only (`skymosaic export camera`), and those from "
            f"0x{HOMOGRAPHY_RING_OFFSET:X} on in live builds with an estimator.",
            "",
        ]
    for register in registers:
        lines += [f"## 0x{register.offset:02X} {register.name}", "", register.description, ""]
        lines += ["| bits | field | access | after reset | meaning |", "|---|---|---|---|---|"]
        lines += [_row(field) for field in register.fields]
        lines.append("")
    return "\n".join(lines)


def _row(field: Field) -> str:
    bits = f"{field.low + field.bits - 1}:{field.low}" if field.bits > 1 else str(field.low)
    reset = "built in" if field.access is Access.CONSTANT else str(field.init)
    return f"| {bits} | `{field.name}` | {field.access.value} | {reset} | {field.description} |"


def svd(registers: Sequence[Register] = REGISTERS) -> str:
    """The register map as a CMSIS-SVD device."""
    device = ET.Element("device", schemaVersion="1.3")
    _texts(
        device,
        name=NAME,
        version=VERSION,
        description="UAV vision front end",
        addressUnitBits="8",
        width=str(REGISTER_BITS),
    )
    peripheral = ET.SubElement(ET.SubElement(device, "peripherals"), "peripheral")
    _texts(peripheral, name=NAME, baseAddress="0x0")
    block = ET.SubElement(peripheral, "addressBlock")
    _texts(block, offset="0x0", size=f"0x{1 << ADDRESS_BITS:X}", usage="registers")
    parent = ET.SubElement(peripheral, "registers")
    for register in registers:
        _svd_register(parent, register)
    ET.indent(device)
    return '<?xml version="1.0" encoding="utf-8"?>\n' + ET.tostring(device, encoding="unicode") + "\n"


def _svd_register(parent: ET.Element, register: Register) -> None:
    element = ET.SubElement(parent, "register")
    _texts(element, name=register.name, description=register.description, addressOffset=f"0x{register.offset:X}")
    # What a build decides has no value here.
    if all(field.access is not Access.CONSTANT for field in register.fields):
        _texts(element, resetValue=f"0x{sum(field.init << field.low for field in register.fields):X}")
    # Behind the register's own elements: CMSIS-SVD prescribes the order.
    fields = ET.SubElement(element, "fields")
    for field in register.fields:
        described = ET.SubElement(fields, "field")
        _texts(
            described,
            name=field.name,
            description=field.description,
            bitOffset=str(field.low),
            bitWidth=str(field.bits),
            access=XML_ACCESS[field.access],
        )
        if field.access is Access.EVENT:
            _texts(described, modifiedWriteValues="oneToClear")


def _texts(parent: ET.Element, **texts: str) -> None:
    for tag, text in texts.items():
        ET.SubElement(parent, tag).text = text


def c_header(registers: Sequence[Register] = REGISTERS) -> str:
    """Offsets, shifts and masks as C macros."""
    guard = f"{NAME.upper()}_REGISTERS_H"
    lines = [
        f"/* Registers of the {NAME} accelerator, version {VERSION}. Generated; do not edit. */",
        f"#ifndef {guard}",
        f"#define {guard}",
    ]
    for register in registers:
        lines += [
            "",
            f"/* {register.description} */",
            f"#define {NAME.upper()}_{register.name} 0x{register.offset:02X}u",
        ]
        for field in register.fields:
            macro = f"{NAME.upper()}_{register.name}_{field.name.upper()}"
            lines += [f"#define {macro}_SHIFT {field.low}u", f"#define {macro}_MASK 0x{field.mask:08X}u"]
    return "\n".join([*lines, "", f"#endif /* {guard} */", ""])


if __name__ == "__main__":
    print(markdown(), end="")
