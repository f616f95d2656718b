"""The register map as documentation and for tools: Markdown, CMSIS-SVD, a C header."""

from collections.abc import Sequence

from golden_model.version import VERSION
from hdl.axi.axi_lite import ADDRESS_BITS
from hdl.registers.register_map import REGISTER_BITS, REGISTERS, Access, Register
from hdl.registers.shell_register_map import ALL_REGISTERS
from hdl.templates import render

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
COMMON = {"name": NAME, "version": VERSION, "register_bits": REGISTER_BITS, "address_bytes": 1 << ADDRESS_BITS}
"""What every template of registers needs."""


def markdown(registers: Sequence[Register] = ALL_REGISTERS) -> str:
    """The register map as a Markdown page; `docs/reference/register_map.md` is that of all builds."""
    offsets = {register.name: register.offset for register in ALL_REGISTERS}
    return render("register_map.md", registers=registers, offsets=offsets, **COMMON)


def svd(registers: Sequence[Register] = REGISTERS) -> str:
    """The register map as a CMSIS-SVD device."""
    resets = {
        register.name: sum(field.init << field.low for field in register.fields)
        for register in registers
        # What a build decides has no value here.
        if all(field.access is not Access.CONSTANT for field in register.fields)
    }
    return render("registers.svd", registers=registers, resets=resets, xml_access=XML_ACCESS, **COMMON)


def c_header(registers: Sequence[Register] = REGISTERS) -> str:
    """Offsets, shifts and masks as C macros."""
    return render("registers.h", registers=registers, **COMMON)


if __name__ == "__main__":
    print(markdown(), end="")
