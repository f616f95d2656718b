"""The host's programs, as an export has them: copies of ``constraints/``, and the build that they are for."""

import shutil
from pathlib import Path

import numpy as np

from golden_model.formats import POSITION
from golden_model.geometry.fixed_point import ENTRY
from golden_model.records import FRAME_STATUS, HOMOGRAPHY, MATCH, WORD_BYTES
from hdl.accelerator import longest_packets
from hdl.build import Build
from hdl.export.boards import SOURCES
from hdl.export.ip_xact import VLNV
from hdl.export.register_docs import NAME
from hdl.registers.register_map import Access, built_constants, fields
from hdl.registers.shell_register_map import list_registers
from hdl.settings import ESTIMATION, PAGE_BYTES, REQUESTED
from hdl.shell.slot import HEADER, HEADER_BYTES
from hdl.templates import render

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
    registers, constants = list_registers(build), built_constants(build)
    # Patch versions have the same registers and records, so the driver accepts all of them.
    del constants["version_patch"]
    written = sorted(fields(*WRITABLE, registers=registers), key=lambda field: field.name)
    requests = ((r.offset, sum(f.mask for f in r.fields if f.access is Access.REQUEST)) for r in registers)
    has_rings = build.shell == "camera"
    records = {"FEATURE": build.config.front_end.pattern.record, "MATCH": MATCH, "STATUS": FRAME_STATUS}
    records |= {"HOMOGRAPHY": HOMOGRAPHY} if build.config.estimator else {}
    return render(
        "skymosaic_map.py.jinja",
        name=NAME,
        core=VLNV,
        fields={f.name: (r.offset, f.low, f.bits) for r in registers for f in r.fields},
        writable={f.name: (f.values[0], f.values[-1]) for f in written},
        requested=REQUESTED,
        estimation=tuple(setting.name for setting in ESTIMATION),
        built=constants,
        request_bits={offset: bits for offset, bits in requests if bits},
        packet_bytes={output: words * WORD_BYTES for output, words in longest_packets(build).items()},
        header=_describe_dtype(HEADER) if has_rings else None,
        header_bytes=HEADER_BYTES,
        page_bytes=PAGE_BYTES,
        unit_px=1 << POSITION.integer_bits,
        max_element=ENTRY.max_raw,
        records={name: (each.tag.value, _describe_dtype(each.dtype)) for name, each in records.items()},
    )


def _describe_dtype(dtype: np.dtype[np.void]) -> dict[str, object]:
    """A structured dtype as the dictionary for ``np.dtype``."""
    names = list(dtype.names or ())
    subtypes = [dtype[name] for name in names]
    # A row of bytes is a subarray, whose own str is only "|V16".
    formats = [(sub.base.str, sub.shape) if sub.shape else sub.str for sub in subtypes]
    assert dtype.fields is not None
    offsets = [dtype.fields[name][1] for name in names]
    return {"names": names, "formats": formats, "offsets": offsets, "itemsize": dtype.itemsize}
