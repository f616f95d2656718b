"""Exports everything needed to build and run the accelerator on a Zynq board, in one folder."""

from __future__ import annotations

import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, TypedDict, Unpack

import numpy as np

from golden_model.config import Config
from golden_model.formats import POSITION
from golden_model.geometry.scoring import ENTRY
from golden_model.records import FRAME_STATUS, HYPOTHESIS, MATCH, SCORE, Tag, feature_record
from golden_model.version import VERSION
from hdl.accelerator import Accelerator, AcceleratorTop
from hdl.blocks.export import CORE_LIBRARY, CORE_VENDOR, core_file, module_ports
from hdl.export import ip_xact, register_docs
from hdl.export.accelerator_bench import accelerator_bench
from hdl.export.boards import SOURCES, board_facts
from hdl.export.bus_interfaces import vivado_attributes
from hdl.netlist import to_verilog
from hdl.registers.live_register_map import LIVE_REGISTERS
from hdl.registers.register_map import REGISTERS, Access, Field, Register, built_constants, fields
from hdl.settings import FLAG, REQUESTED, SETTINGS, SHELL
from hdl.shell.live import LIVE_VIDEO_BITS, LiveAccelerator, LiveTop
from hdl.shell.slot import HEADER

TOP, LIVE_TOP = "skymosaic", "skymosaic_live"
# Vivado numbers a core by major.minor and keeps a revision beside it (UG1118).
CORE_VERSION, _, CORE_REVISION = VERSION.rpartition(".")
VLNV = f"{CORE_VENDOR}:{CORE_LIBRARY}:{TOP}:{CORE_VERSION}"
_WRITABLE = (Access.SETTING, Access.REQUEST, Access.COMMAND)


class Build(TypedDict, total=False):
    """Parameters of `hdl.accelerator.Accelerator` besides the configuration, with its defaults."""

    lanes: int
    max_width_px: int
    max_height_px: int
    video_bits: int


DEFAULT_BUILD = Build(lanes=16, max_width_px=1920, max_height_px=1080, video_bits=32)
VIDEO = {
    32: "32-bit words from a DMA, or AXI4-Stream video in their low bytes",
    24: "AXI4-Stream video in RGB, 8 bits a colour (UG934)",
    8: "AXI4-Stream video in gray, 8 bits (UG934)",
    48: "AXI4-Stream video in RGB, two pixels a clock, 8 bits a colour (UG934)",
    16: "AXI4-Stream video in gray, two pixels a clock, 8 bits each (UG934)",
}


def top_module(config: Config, build: Build) -> AcceleratorTop:
    """The accelerator with its AXI ports."""
    return AcceleratorTop(Accelerator(config=config, **build))


def verilog(top: AcceleratorTop) -> str:
    """The accelerator in Verilog, top module ``skymosaic``; Vivado finds its buses by attributes of the ports."""
    return to_verilog(top, name=TOP, aliases=False, port_attributes=vivado_attributes(top.signature.members))


def export(folder: Path, *, board: str, config: Config, **build: Unpack[Build]) -> None:
    """Write Verilog, Tcl, constraints, register map, driver and README into ``folder``.

    Parameters
    ----------
    folder : Path
        Created if missing; files of the same names are replaced.
    board : str
        One of `hdl.export.boards.BOARDS`.
    config : Config
        Of front end and matcher.
    **build : Build
        ``lanes``, ``max_width_px``, ``max_height_px``, ``video_bits``, as `hdl.accelerator.Accelerator` takes them;
        what is left out is as in `DEFAULT_BUILD`.

    Raises
    ------
    ValueError
        For an unknown board, naming the valid ones, or for an impossible build.
    OSError
        If the folder cannot be written.
    """
    facts, build = board_facts(board), DEFAULT_BUILD | build
    top = top_module(config, build)
    text = verilog(top)
    rtl, vivado, registers, simulation = (folder / name for name in ("rtl", "vivado", "registers", "sim"))
    for subfolder in (rtl, vivado, registers, simulation):
        subfolder.mkdir(parents=True, exist_ok=True)
    (rtl / f"{TOP}.v").write_text(text)
    bench = accelerator_bench(TOP, module_ports(top), config, video_bits=build["video_bits"]).files()
    for name, content in bench.items():
        (simulation / name).write_text(content)
    (folder / f"{TOP}.xml").write_text(ip_xact.component(TOP, module_ports(top), f"rtl/{TOP}.v"))
    _write_litex(folder / "litex", build["video_bits"])
    (folder / f"{TOP}.core").write_text(core_file(TOP, [f"rtl/{TOP}.v"], [f"sim/{name}" for name in bench]))
    _write_vivado(vivado, board, facts["family"], build["video_bits"])
    write_registers(registers, REGISTERS)
    has_processor = facts["family"].startswith("zynq")
    if has_processor:
        write_host(folder / "pynq", "pynq", config, **build)
    use = (SOURCES / "systems" / ("pynq.md" if has_processor else "jtag.md")).read_text()
    facts |= {
        "board": board,
        "levels": str(config.front_end.levels),
        "descriptor": config.front_end.descriptor,
        "features": str(config.front_end.max_features),
        "video": VIDEO[build["video_bits"]],
        **{name: str(value) for name, value in build.items()},
    }
    (folder / "README.md").write_text(((SOURCES / "README.md").read_text() + use).format(**facts))


def export_live(folder: Path, *, config: Config, **build: Unpack[Build]) -> None:
    """Write the live build's Verilog, its registers, the reader of its rings, and a README into ``folder``.

    Parameters
    ----------
    folder, config, **build
        As for `export`.

    Raises
    ------
    ValueError
        For an impossible build; a live one has a video input of 24 or 8 bits.
    OSError
        If the folder cannot be written.
    """
    build = DEFAULT_BUILD | build
    if build["video_bits"] not in LIVE_VIDEO_BITS:
        raise ValueError(f"a live build takes video of {' or '.join(map(str, LIVE_VIDEO_BITS))} bits")
    top = LiveTop(LiveAccelerator(config=config, **build))
    text = to_verilog(top, name=LIVE_TOP, aliases=False)
    for subfolder in ("rtl", "registers"):
        (folder / subfolder).mkdir(parents=True, exist_ok=True)
    (folder / "rtl" / f"{LIVE_TOP}.v").write_text(text)
    write_registers(folder / "registers", LIVE_REGISTERS)
    write_host(folder / "host", "live", config, **build)
    facts = {name: str(value) for name, value in build.items()} | {"video": VIDEO[build["video_bits"]]}
    (folder / "README.md").write_text((SOURCES / "live" / "README.md").read_text().format(**facts))


def write_registers(folder: Path, registers: Sequence[Register]) -> None:
    """Write the map as Markdown, CMSIS-SVD and C header."""
    (folder / "register_map.md").write_text(register_docs.markdown(registers))
    (folder / f"{TOP}.svd").write_text(register_docs.svd(registers))
    (folder / f"{TOP}_registers.h").write_text(register_docs.c_header(registers))


def _write_vivado(folder: Path, board: str, family: str, video_bits: int) -> None:
    """Scripts and constraints; ``board.tcl`` and ``system.tcl`` are those of the board and its family."""
    for source in (SOURCES / "vivado").iterdir():
        shutil.copy(source, folder)
    shutil.copy(SOURCES / "systems" / f"{family}.tcl", folder / "system.tcl")
    board_text = (SOURCES / "boards" / f"{board}.tcl").read_text()
    facts = {"video_bits": video_bits, "core": VLNV, "core_version": CORE_VERSION, "core_revision": CORE_REVISION}
    (folder / "board.tcl").write_text(board_text + "".join(f"set board({name}) {facts[name]}\n" for name in facts))
    pins = SOURCES / "boards" / f"{board}.xdc"
    if pins.exists():
        shutil.copy(pins, folder / "bitstream_pins.xdc")


def _write_litex(folder: Path, video_bits: int) -> None:
    """The wrapper for LiteX, for this width of the video input."""
    folder.mkdir(parents=True, exist_ok=True)
    text = (SOURCES / "litex" / "skymosaic_litex.py").read_text()
    (folder / "skymosaic_litex.py").write_text(text.replace("VIDEO_BITS = 32", f"VIDEO_BITS = {video_bits}"))


HOST_FOLDERS = {"pynq": ("host", "server", "pynq"), "serial": ("host", "server", "serial"), "live": ("host", "live")}
"""Where the programs of a host come from."""


def write_host(folder: Path, kind: Literal["pynq", "serial", "live"], config: Config, **build: Unpack[Build]) -> None:
    """Write the programs of the host: driver and server for a processor's DMAs or a serial port, or a live reader."""
    folder.mkdir(parents=True, exist_ok=True)
    for source in (path for name in HOST_FOLDERS[kind] for path in (SOURCES / name).iterdir()):
        if source.suffix in {".py", ".ipynb"}:
            shutil.copy(source, folder)
    (folder / "skymosaic_map.py").write_text(driver_map(config, live=kind == "live", **build))


def driver_map(config: Config, *, live: bool = False, **build: Unpack[Build]) -> str:
    """The Python module ``skymosaic_map``: registers, records and build constants for the driver."""
    registers = LIVE_REGISTERS if live else REGISTERS
    constants = built_constants(
        front_end=config.front_end, matcher=config.matcher, live=live, **(DEFAULT_BUILD | build)
    )
    # Patch versions have the same registers and records: the driver accepts them all.
    del constants["version_patch"]
    pattern = config.front_end.pattern
    positions = {f.name: (r.offset, f.low, f.bits) for r in registers for f in r.fields}
    written = sorted(fields(*_WRITABLE, registers=registers), key=lambda field: field.name)
    writable = {f.name: _valid(f) for f in written}
    records = {
        "FEATURE": feature_record(pattern.descriptor_bytes, pattern.window_bytes).dtype,
        "MATCH": MATCH.dtype,
        "STATUS": FRAME_STATUS.dtype,
        **({"HEADER": HEADER, "HYPOTHESIS": HYPOTHESIS.dtype, "SCORE": SCORE.dtype} if live else {}),
    }
    tags = (Tag.FRAME_STATUS, *((Tag.HYPOTHESIS, Tag.SCORE) if live else ()))
    requests = ((r.offset, sum(f.mask for f in r.fields if f.access is Access.REQUEST)) for r in registers)
    request_bits = {offset: bits for offset, bits in requests if bits}
    lines = [
        f'"""Registers and records of the {TOP} accelerator. Generated; do not edit."""',
        "",
        "import numpy as np",
        "",
        *_dictionary("FIELDS", positions, "Field: (byte offset of its register, lowest bit, bits)"),
        *_dictionary("WRITABLE", writable, "Field that can be written: (smallest, largest valid value)"),
        f"CORE = {VLNV!r}",
        "# What a request to the server sets.",
        f"REQUESTED = {REQUESTED!r}",
        *_dictionary("BUILT", constants, "What the constant fields read."),
        *_dictionary("REQUEST_BITS", request_bits, "Offset of a register: bits that request something"),
        *(f"{tag.name.removeprefix('FRAME_')}_TAG = {int(tag)}" for tag in tags),
        *([f"UNIT_PX, LARGEST_ELEMENT = {1 << POSITION.integer_bits}, {ENTRY.max_raw}"] if live else []),
        *(f"{name} = np.dtype({_dtype_text(dtype)})" for name, dtype in records.items()),
    ]
    return "\n".join(lines) + "\n"


def _dictionary(name: str, entries: Mapping[Any, object], comment: str) -> list[str]:
    """Source lines of a dictionary, an entry a line."""
    return [f"# {comment}", f"{name} = {{", *(f"    {key!r}: {value!r}," for key, value in entries.items()), "}"]


def _valid(field: Field) -> tuple[int, int]:
    """Smallest and largest value that may be written into a field."""
    values = (SETTINGS | SHELL)[field.name].values if field.access is Access.SETTING else FLAG
    return values[0], values[-1]


def _dtype_text(dtype: np.dtype[np.void]) -> str:
    """Source text of a structured dtype: the dictionary for ``np.dtype``."""
    names = list(dtype.names or ())
    subtypes = [dtype[name] for name in names]
    formats = [(sub.base.str, sub.shape) if sub.shape else sub.str for sub in subtypes]
    assert dtype.fields is not None
    offsets = [dtype.fields[name][1] for name in names]
    return repr({"names": names, "formats": formats, "offsets": offsets, "itemsize": dtype.itemsize})
