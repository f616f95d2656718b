"""Exports everything needed to build and run the accelerator on a board, in one folder."""

import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, TypedDict, Unpack

import numpy as np

from golden_model.config import Config
from golden_model.formats import POSITION
from golden_model.geometry.scoring import ENTRY
from golden_model.records import FRAME_STATUS, HOMOGRAPHY, HYPOTHESIS, MATCH, SCORE, Tag
from golden_model.version import VERSION
from hdl.accelerator import Accelerator, AcceleratorTop, output_names
from hdl.axi.packet_gate import CLOSING_RECORDS
from hdl.blocks.export import CORE_LIBRARY, CORE_VENDOR, core_file, module_ports
from hdl.export import ip_xact, register_docs
from hdl.export.accelerator_bench import make_accelerator_bench
from hdl.export.boards import SOURCES, board_facts
from hdl.export.bus_interfaces import vivado_attributes
from hdl.export.live_bench import make_live_bench
from hdl.netlist import to_verilog
from hdl.registers.live_register_map import list_shell_registers
from hdl.registers.register_map import Access, Field, Register, built_constants, fields, list_registers
from hdl.settings import ESTIMATION, ESTIMATOR, FLAG, PAGE_BYTES, REQUESTED, SETTINGS, SHELL
from hdl.shell.live import LIVE_VIDEO_BITS, LiveAccelerator, LiveTop
from hdl.shell.slot import HEADER, HEADER_BYTES

TOP, LIVE_TOP = "skymosaic", "skymosaic_live"
# Vivado numbers a core by major.minor and keeps a revision beside it (UG1118).
CORE_VERSION, _, CORE_REVISION = VERSION.rpartition(".")
VLNV = f"{CORE_VENDOR}:{CORE_LIBRARY}:{TOP}:{CORE_VERSION}"
_WRITABLE = (Access.SETTING, Access.REQUEST, Access.COMMAND)


class Build(TypedDict, total=False):
    """Parameters of `hdl.accelerator.Accelerator` besides the configuration."""

    lanes: int
    max_width_px: int
    max_height_px: int
    video_bits: int


DEFAULT_BUILD = Build(lanes=16, max_width_px=1920, max_height_px=1080, video_bits=32)
VIDEO = {
    32: "32-bit words from a DMA, or AXI4-Stream video in their low bytes",
    24: "AXI4-Stream video in RGB, 8 bits per colour (UG934)",
    8: "AXI4-Stream video in gray, 8 bits (UG934)",
    48: "AXI4-Stream video in RGB, two pixels per clock, 8 bits per colour (UG934)",
    16: "AXI4-Stream video in gray, two pixels per clock, 8 bits each (UG934)",
}


def top_module(config: Config, build: Build) -> AcceleratorTop:
    """The accelerator with its AXI ports."""
    return AcceleratorTop(Accelerator(config=config, **build))


def verilog(top: AcceleratorTop) -> str:
    """The accelerator in Verilog, top module ``skymosaic``; from attributes of its ports, Vivado infers the buses."""
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
        Configuration of front end and matcher.
    **build : Build
        ``lanes``, ``max_width_px``, ``max_height_px``, ``video_bits`` of `hdl.accelerator.Accelerator`; the defaults
        are those in `DEFAULT_BUILD`.

    Raises
    ------
    ValueError
        For an unknown board, naming the valid ones, or for an impossible build.
    OSError
        If the folder cannot be written.
    """
    facts, build = board_facts(board), DEFAULT_BUILD | build
    top = top_module(config, build)
    ports, family, video_bits = module_ports(top), facts["family"], build["video_bits"]
    bench = make_accelerator_bench(TOP, ports, config, video_bits=video_bits).files()
    outputs = output_names(config)
    litex = (SOURCES / "litex" / "skymosaic_litex.py").read_text()
    litex = litex.replace("VIDEO_BITS = 32", f"VIDEO_BITS = {video_bits}")
    litex = litex.replace('OUTPUTS = ("features", "matches")', f"OUTPUTS = {outputs!r}")
    facts |= {"board": board, "levels": str(config.front_end.levels), "descriptor": config.front_end.descriptor}
    has_processor = family.startswith("zynq")
    readme = ["README.md", "systems/pynq.md" if has_processor else "systems/jtag.md"]
    write_files(
        folder,
        {
            **core_files(TOP, verilog(top), list_registers(config)),
            **{f"sim/{name}": text for name, text in bench.items()},
            f"{TOP}.xml": ip_xact.component(TOP, ports, f"rtl/{TOP}.v", list_registers(config)),
            f"{TOP}.core": core_file(TOP, [f"rtl/{TOP}.v"], [f"sim/{name}" for name in bench]),
            "litex/skymosaic_litex.py": litex,
            **_vivado_files(board, family, video_bits, outputs),
            "README.md": fill_readme(readme, config, build, **facts),
        },
    )
    if has_processor:
        write_host(folder / "pynq", "pynq", config, **build)


def export_live(folder: Path, *, config: Config, **build: Unpack[Build]) -> None:
    """Write a live build's Verilog, its registers, the reader of its rings, and a README into ``folder``.

    Parameters
    ----------
    folder, config, **build
        As for `export`, but ``video_bits`` is 24 by default.

    Raises
    ------
    ValueError
        For an impossible build, or a video input of other than 24 or 8 bits.
    OSError
        If the folder cannot be written.
    """
    # A camera sends pixels; the default of 32 bits is for a DMA that reads them from memory.
    build = DEFAULT_BUILD | Build(video_bits=24) | build
    if build["video_bits"] not in LIVE_VIDEO_BITS:
        raise ValueError(f"a live build takes video of {' or '.join(map(str, LIVE_VIDEO_BITS))} bits")
    top = LiveTop(LiveAccelerator(config=config, **build))
    verilog = to_verilog(top, name=LIVE_TOP, aliases=False)
    bench = make_live_bench(LIVE_TOP, module_ports(top), config, video_bits=build["video_bits"]).files()
    write_files(
        folder,
        {
            **core_files(LIVE_TOP, verilog, (*list_registers(config), *list_shell_registers(config))),
            **{f"sim/{name}": text for name, text in bench.items()},
            f"{LIVE_TOP}.core": core_file(LIVE_TOP, [f"rtl/{LIVE_TOP}.v"], [f"sim/{name}" for name in bench]),
            f"constraints/{LIVE_TOP}.xdc": (SOURCES / "live" / f"{LIVE_TOP}.xdc").read_text(),
            "README.md": fill_readme(["live/README.md"], config, build),
        },
    )
    write_host(folder / "host", "live", config, **build)


def core_files(name: str, verilog: str, registers: Sequence[Register]) -> dict[str, str]:
    """The Verilog, and the register map as Markdown, CMSIS-SVD and C header, by path in the export."""
    return {
        f"rtl/{name}.v": verilog,
        "registers/register_map.md": register_docs.markdown(registers),
        f"registers/{TOP}.svd": register_docs.svd(registers),
        f"registers/{TOP}_registers.h": register_docs.c_header(registers),
    }


def fill_readme(parts: Sequence[str], config: Config, build: Build, **facts: str) -> str:
    """Join the parts of a README, and put the build and ``facts`` into its placeholders."""
    # str.format: literal braces in the Markdown are doubled.
    text = "".join((SOURCES / part).read_text() for part in parts)
    return text.format(video=VIDEO[build["video_bits"]], features=config.front_end.max_features, **build, **facts)


def write_files(folder: Path, texts: Mapping[str, str]) -> None:
    """Write files by their paths in ``folder``."""
    for name, text in texts.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)


def _vivado_files(board: str, family: str, video_bits: int, outputs: Sequence[str]) -> dict[str, str]:
    """Scripts and constraints; ``board.tcl`` and ``system.tcl`` describe the board and its family."""
    files = {source.name: source.read_text() for source in (SOURCES / "vivado").iterdir()}
    files["system.tcl"] = (SOURCES / "systems" / f"{family}.tcl").read_text()
    facts = {"video_bits": video_bits, "core": VLNV, "core_version": CORE_VERSION, "core_revision": CORE_REVISION}
    facts |= {"outputs": "{" + " ".join(outputs) + "}"}
    lines = [f"set board({name}) {value}\n" for name, value in facts.items()]
    files["board.tcl"] = "".join([(SOURCES / "boards" / f"{board}.tcl").read_text(), *lines])
    pins = SOURCES / "boards" / f"{board}.xdc"
    if pins.exists():
        files["bitstream_pins.xdc"] = pins.read_text()
    return {f"vivado/{name}": text for name, text in files.items()}


HOST_FOLDERS = {
    "pynq": ("host", "server", "pynq_common", "pynq"),
    "serial": ("host", "server", "serial"),
    "live": ("host", "pynq_common", "live"),
}
"""The folders of `SOURCES` with the programs for each kind of host."""


def write_host(folder: Path, kind: Literal["pynq", "serial", "live"], config: Config, **build: Unpack[Build]) -> None:
    """Write the host's programs: driver and server for a processor's DMAs or a serial port, or the reader of rings."""
    folder.mkdir(parents=True, exist_ok=True)
    for source in (path for name in HOST_FOLDERS[kind] for path in (SOURCES / name).iterdir()):
        if source.suffix in {".py", ".ipynb"}:
            shutil.copy(source, folder)
    (folder / "skymosaic_map.py").write_text(driver_map(config, live=kind == "live", **build))


def driver_map(config: Config, *, live: bool = False, **build: Unpack[Build]) -> str:
    """The Python module ``skymosaic_map``: registers, records and build constants for the driver."""
    registers = (*list_registers(config), *(list_shell_registers(config) if live else ()))
    constants = built_constants(config, live=live, **(DEFAULT_BUILD | build))
    # Patch versions have the same registers and records, so the driver accepts all of them.
    del constants["version_patch"]
    pattern = config.front_end.pattern
    positions = {f.name: (r.offset, f.low, f.bits) for r in registers for f in r.fields}
    written = sorted(fields(*_WRITABLE, registers=registers), key=lambda field: field.name)
    writable = {f.name: _valid_range(f) for f in written}
    records = {
        "FEATURE": pattern.record.dtype,
        "MATCH": MATCH.dtype,
        "STATUS": FRAME_STATUS.dtype,
        **({"HOMOGRAPHY": HOMOGRAPHY.dtype} if config.estimator else {}),
        **({"HEADER": HEADER, "HYPOTHESIS": HYPOTHESIS.dtype, "SCORE": SCORE.dtype} if live else {}),
    }
    tags = [Tag.FRAME_STATUS, *((Tag.HYPOTHESIS, Tag.SCORE) if live else ())]
    tags += [Tag.HOMOGRAPHY] if config.estimator else []
    requests = ((r.offset, sum(f.mask for f in r.fields if f.access is Access.REQUEST)) for r in registers)
    request_bits = {offset: bits for offset, bits in requests if bits}
    lines = [
        f'"""Registers and records of the {TOP} accelerator. Generated; do not edit."""',
        "",
        "import numpy as np",
        "",
        *_dictionary("FIELDS", positions, "Field: (byte offset of its register, lowest bit, bits)"),
        *_dictionary("WRITABLE", writable, "Writable field: (smallest, largest valid value)"),
        f"CORE = {VLNV!r}",
        "# The fields in a request to the server.",
        f"REQUESTED = {REQUESTED!r}",
        "# Those besides, in a request for homographies.",
        f"ESTIMATION = {tuple(setting.name for setting in ESTIMATION)!r}",
        *_dictionary("BUILT", constants, "Values of the constant fields"),
        *_dictionary("REQUEST_BITS", request_bits, "Offset of a register: its bits that are requests"),
        *(f"{tag.name.removeprefix('FRAME_')}_TAG = {int(tag)}" for tag in tags),
        "# A packet that is ended early is longer by this number of records.",
        f"CLOSING_RECORDS = {CLOSING_RECORDS}",
        "# A DMA's register LENGTH has 26 bits: 2^26 bytes, a frame of 4096x4096 in colour, would be 0.",
        "MAX_TRANSFER_BYTES = (1 << 26) - 1",
        *([f"PAGE_BYTES, HEADER_BYTES = {PAGE_BYTES}, {HEADER_BYTES}"] if live else []),
        *([f"UNIT_PX, MAX_ELEMENT = {1 << POSITION.integer_bits}, {ENTRY.max_raw}"] if live else []),
        *(f"{name} = np.dtype({_dtype_text(dtype)})" for name, dtype in records.items()),
    ]
    return "\n".join(lines) + "\n"


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
