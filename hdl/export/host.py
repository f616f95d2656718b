"""The host's programs, as an export has them: copies of ``constraints/``, and the build that they are for."""

import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from golden_model.formats import POSITION
from golden_model.geometry.scoring import ENTRY
from golden_model.records import FRAME_STATUS, HOMOGRAPHY, HYPOTHESIS, MATCH, SCORE, WORD_BYTES
from hdl.accelerator import longest_packets
from hdl.build import Build
from hdl.export.boards import SOURCES
from hdl.export.ip_xact import VLNV
from hdl.export.register_docs import NAME
from hdl.registers.register_map import Access, Field, built_constants, fields
from hdl.registers.shell_register_map import list_registers
from hdl.settings import ESTIMATION, ESTIMATOR, FLAG, PAGE_BYTES, REQUESTED, SETTINGS, SHELL
from hdl.shell.slot import HEADER, HEADER_BYTES

WRITABLE = (Access.SETTING, Access.REQUEST, Access.COMMAND)
HOST_FOLDERS = {
    "streams": ("host", "server", "pynq_common", "pynq"),
    "serial": ("host", "server", "serial"),
    "camera": ("host", "pynq_common", "camera"),
}
"""The folders of `SOURCES` with the programs for each shell."""


def write_host(folder: Path, build: Build) -> None:
    """Write the host's programs: driver and server for a processor's DMAs or a serial port, or the reader of rings."""
    folder.mkdir(parents=True, exist_ok=True)
    for source in (path for name in HOST_FOLDERS[build.shell] for path in (SOURCES / name).iterdir()):
        if source.suffix in {".py", ".ipynb"}:
            shutil.copy(source, folder)
    (folder / "skymosaic_map.py").write_text(driver_map(build))


def driver_map(build: Build) -> str:
    """The Python module ``skymosaic_map``: registers, records and build constants for the driver."""
    title = f'"""Registers and records of the {NAME} accelerator. Generated; do not edit."""'
    head = [title, "", "import numpy as np", ""]
    return "\n".join([*head, *_describe_registers(build), *_describe_packets(build), ""])


def _describe_registers(build: Build) -> list[str]:
    registers, constants = list_registers(build), built_constants(build)
    # Patch versions have the same registers and records, so the driver accepts all of them.
    del constants["version_patch"]
    positions = {f.name: (r.offset, f.low, f.bits) for r in registers for f in r.fields}
    written = sorted(fields(*WRITABLE, registers=registers), key=lambda field: field.name)
    requests = ((r.offset, sum(f.mask for f in r.fields if f.access is Access.REQUEST)) for r in registers)
    return [
        *_dictionary("FIELDS", positions, "Field: (byte offset of its register, lowest bit, bits)"),
        *_dictionary(
            "WRITABLE", {f.name: _valid_range(f) for f in written}, "Writable field: (smallest, largest valid value)"
        ),
        f"CORE = {VLNV!r}",
        "# The fields in a request to the server.",
        f"REQUESTED = {REQUESTED!r}",
        "# What a request for homographies has besides.",
        f"ESTIMATION = {tuple(setting.name for setting in ESTIMATION)!r}",
        *_dictionary("BUILT", constants, "Values of the constant fields"),
        *_dictionary("REQUEST_BITS", {r: bits for r, bits in requests if bits}, "Offset of a register: its requests"),
    ]


def _describe_packets(build: Build) -> list[str]:
    records = {"FEATURE": build.config.front_end.pattern.record, "MATCH": MATCH, "STATUS": FRAME_STATUS}
    records |= {"HOMOGRAPHY": HOMOGRAPHY} if build.config.estimator else {}
    packet_bytes = {output: words * WORD_BYTES for output, words in longest_packets(build).items()}
    in_memory = []
    if build.shell == "camera":
        records |= {"HYPOTHESIS": HYPOTHESIS, "SCORE": SCORE}
        in_memory = [
            f"PAGE_BYTES, HEADER_BYTES = {PAGE_BYTES}, {HEADER_BYTES}",
            f"HEADER = np.dtype({_dtype_text(HEADER)})",
            f"UNIT_PX, MAX_ELEMENT = {1 << POSITION.integer_bits}, {ENTRY.max_raw}",
        ]
    return [
        *_dictionary("PACKET_BYTES", packet_bytes, "Output: bytes of its longest packet"),
        "# A DMA's register LENGTH has 26 bits: 2^26 bytes, a frame of 4096x4096 in colour, would be 0.",
        "MAX_TRANSFER_BYTES = (1 << 26) - 1",
        *in_memory,
        *(f"{name}_TAG, {name} = {each.tag:d}, np.dtype({_dtype_text(each.dtype)})" for name, each in records.items()),
    ]


def _dictionary(name: str, entries: Mapping[Any, object], comment: str) -> list[str]:
    """Source lines of a dictionary, one entry per line."""
    return [f"# {comment}", f"{name} = {{", *(f"    {key!r}: {value!r}," for key, value in entries.items()), "}"]


def _valid_range(field: Field) -> tuple[int, int]:
    """Smallest and largest value that may be written into a field."""
    values = (SETTINGS | ESTIMATOR | SHELL)[field.name].values if field.access is Access.SETTING else FLAG
    return values[0], values[-1]


def _dtype_text(dtype: np.dtype[np.void]) -> str:
    """Source text of a structured dtype: the dictionary for ``np.dtype``."""
    names = list(dtype.names or ())
    subtypes = [dtype[name] for name in names]
    # A row of bytes is a subarray, whose own str is only "|V16".
    formats = [(sub.base.str, sub.shape) if sub.shape else sub.str for sub in subtypes]
    assert dtype.fields is not None
    offsets = [dtype.fields[name][1] for name in names]
    return repr({"names": names, "formats": formats, "offsets": offsets, "itemsize": dtype.itemsize})
