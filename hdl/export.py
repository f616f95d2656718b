"""Exports everything needed to build and run the accelerator on a Zynq board, in one folder."""

from __future__ import annotations

import re
import shutil
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from golden_model.config import Config
from golden_model.records import FRAME_STATUS, MATCH, Tag, feature_record
from hdl.accelerator import Accelerator, AcceleratorTop
from hdl.axi import register_docs
from hdl.axi.register_map import REGISTERS, Access, Field, built_constants, fields
from hdl.boards import BOARDS, SOURCES
from hdl.netlist import to_verilog
from hdl.settings import FLAG, REQUESTED, SETTINGS

TOP = "skymosaic"
_WRITABLE = (Access.SETTING, Access.REQUEST, Access.COMMAND)


def verilog(*, config: Config, lanes: int, max_width_px: int, max_height_px: int) -> str:
    """The accelerator in Verilog, top module ``skymosaic``."""
    accelerator = Accelerator(config=config, lanes=lanes, max_width_px=max_width_px, max_height_px=max_height_px)
    return to_verilog(AcceleratorTop(accelerator), name=TOP)


def export(
    folder: Path, *, board: str, config: Config, lanes: int = 16, max_width_px: int = 1920, max_height_px: int = 1080
) -> None:
    """Write Verilog, Tcl, constraints, register map, driver and README into ``folder``.

    Parameters
    ----------
    folder : Path
        Created if missing; files of the same names are replaced.
    board : str
        One of `hdl.boards.BOARDS`.
    config, lanes, max_width_px, max_height_px
        See `hdl.accelerator.Accelerator`.

    Raises
    ------
    ValueError
        For an unknown board, naming the valid ones, or for an impossible build.
    OSError
        If the folder cannot be written.
    """
    if board not in BOARDS:
        raise ValueError(f"unknown board {board!r}; valid: {', '.join(BOARDS)}")
    build = {"lanes": lanes, "max_width_px": max_width_px, "max_height_px": max_height_px}
    rtl, vivado, registers, pynq = (folder / name for name in ("rtl", "vivado", "registers", "pynq"))
    for subfolder in (rtl, vivado, registers, pynq):
        subfolder.mkdir(parents=True, exist_ok=True)
    (rtl / f"{TOP}.v").write_text(verilog(config=config, **build))
    for source in (SOURCES / "vivado").iterdir():
        shutil.copy(source, vivado)
    board_file = SOURCES / "boards" / f"{board}.tcl"
    shutil.copy(board_file, vivado / "board.tcl")
    (registers / "register_map.md").write_text(register_docs.markdown())
    (registers / f"{TOP}.svd").write_text(register_docs.svd())
    (registers / f"{TOP}_registers.h").write_text(register_docs.c_header())
    for source in (SOURCES / "pynq").glob("*.py"):
        shutil.copy(source, pynq)
    (pynq / "skymosaic_map.py").write_text(driver_map(config, **build))
    part = re.search(r"part\s+(\S+)", board_file.read_text())
    readme = (SOURCES / "README.md").read_text()
    facts = {
        "board": board,
        "part": part.group(1) if part else "",
        "levels": config.front_end.levels,
        "width": max_width_px,
        "height": max_height_px,
        "descriptor": config.front_end.descriptor,
        "features": config.front_end.max_features,
        "lanes": lanes,
    }
    (folder / "README.md").write_text(readme.format(**facts))


def driver_map(config: Config, *, lanes: int, max_width_px: int, max_height_px: int) -> str:
    """The Python module ``skymosaic_map``: registers, records and build constants for the driver."""
    constants = built_constants(
        front_end=config.front_end,
        matcher=config.matcher,
        lanes=lanes,
        max_width_px=max_width_px,
        max_height_px=max_height_px,
    )
    pattern = config.front_end.pattern
    positions = {f.name: (r.offset, f.low, f.bits) for r in REGISTERS for f in r.fields}
    writable = {f.name: _valid(f) for f in sorted(fields(*_WRITABLE), key=lambda field: field.name)}
    records = {
        "FEATURE": feature_record(pattern.descriptor_bytes, pattern.window_bytes).dtype,
        "MATCH": MATCH.dtype,
        "STATUS": FRAME_STATUS.dtype,
    }
    lines = [
        f'"""Registers and records of the {TOP} accelerator. Generated; do not edit."""',
        "",
        "import numpy as np",
        "",
        *_dictionary("FIELDS", positions, "Field: (byte offset of its register, lowest bit, bits)"),
        *_dictionary("WRITABLE", writable, "Field that can be written: (smallest, largest valid value)"),
        "# What a request to the server sets.",
        f"REQUESTED = {REQUESTED!r}",
        *_dictionary("BUILT", constants, "What the constant fields read."),
        f"STATUS_TAG = {int(Tag.FRAME_STATUS)}",
        *(f"{name} = np.dtype({_dtype_text(dtype)})" for name, dtype in records.items()),
    ]
    return "\n".join(lines) + "\n"


def _dictionary(name: str, entries: Mapping[str, object], comment: str) -> list[str]:
    """Source lines of a dictionary, an entry a line."""
    return [f"# {comment}", f"{name} = {{", *(f"    {key!r}: {value!r}," for key, value in entries.items()), "}"]


def _valid(field: Field) -> tuple[int, int]:
    """Smallest and largest value that may be written into a field."""
    values = SETTINGS[field.name].values if field.access is Access.SETTING else FLAG
    return values[0], values[-1]


def _dtype_text(dtype: np.dtype[np.void]) -> str:
    """Source text of a structured dtype: the dictionary for ``np.dtype``."""
    names = list(dtype.names or ())
    subtypes = [dtype[name] for name in names]
    formats = [(sub.base.str, sub.shape) if sub.shape else sub.str for sub in subtypes]
    assert dtype.fields is not None
    offsets = [dtype.fields[name][1] for name in names]
    return repr({"names": names, "formats": formats, "offsets": offsets, "itemsize": dtype.itemsize})
