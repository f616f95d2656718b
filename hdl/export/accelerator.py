"""Exports everything needed to build and run the accelerator, on a board or behind a camera, in one folder."""

from collections.abc import Sequence
from pathlib import Path

from hdl.accelerator import AcceleratorTop
from hdl.blocks.export import core_file, module_ports, write_files
from hdl.blocks.testbench import VerilogBench
from hdl.build import Build
from hdl.export import ip_xact, register_docs
from hdl.export.accelerator_bench import make_accelerator_bench
from hdl.export.boards import SOURCES, board_facts
from hdl.export.camera_bench import make_camera_bench
from hdl.export.host import write_host
from hdl.export.ip_xact import vivado_attributes
from hdl.netlist import to_verilog
from hdl.registers.shell_register_map import list_registers
from hdl.shell.camera_top import CameraTop

TOP, CAMERA_TOP = register_docs.NAME, "skymosaic_camera"
VIDEO = {
    32: "32-bit words from a DMA, or AXI4-Stream video in their low bytes",
    24: "AXI4-Stream video in RGB, 8 bits per colour (UG934)",
    8: "AXI4-Stream video in gray, 8 bits (UG934)",
    48: "AXI4-Stream video in RGB, two pixels per clock, 8 bits per colour (UG934)",
    16: "AXI4-Stream video in gray, two pixels per clock, 8 bits each (UG934)",
}


def verilog(top: AcceleratorTop) -> str:
    """The accelerator in Verilog, top module ``skymosaic``; from attributes of its ports, Vivado infers the buses."""
    return to_verilog(top, name=TOP, aliases=False, port_attributes=vivado_attributes(top.signature.members))


def export_board(folder: Path, board: str, build: Build) -> None:
    """Write Verilog, Tcl, constraints, register map, driver and README into ``folder``.

    Parameters
    ----------
    folder : Path
        Created if missing; files of the same names are replaced.
    board : str
        One of `hdl.export.boards.BOARDS`.
    build : Build
        With the shell ``streams``.

    Raises
    ------
    ValueError
        For an unknown board, naming the valid ones.
    """
    facts, config = board_facts(board), build.config
    top = AcceleratorTop(build)
    ports, family = module_ports(top), facts["family"]
    litex = (SOURCES / "litex" / "skymosaic_litex.py").read_text()
    litex = litex.replace("VIDEO_BITS = 0", f"VIDEO_BITS = {build.video_bits}")
    litex = litex.replace("OUTPUTS = ()", f"OUTPUTS = {build.outputs!r}")
    facts |= {"board": board, "levels": str(config.front_end.levels), "descriptor": config.front_end.descriptor}
    has_processor = family.startswith("zynq")
    readme = ["README.md", "systems/pynq.md" if has_processor else "systems/jtag.md"]
    write_files(
        folder,
        {
            **core_files(TOP, verilog(top), build),
            **bench_files(TOP, make_accelerator_bench(TOP, ports, build)),
            f"{TOP}.xml": ip_xact.component(ports, f"rtl/{TOP}.v", list_registers(build)),
            "litex/skymosaic_litex.py": litex,
            **_vivado_files(board, family, build),
            "README.md": fill_readme(readme, build, **facts),
        },
        build,
    )
    if has_processor:
        write_host(folder / "pynq", build)


def export_camera(folder: Path, build: Build) -> None:
    """Write Verilog, registers, reader of the rings and README of a build with the shell ``camera`` into ``folder``."""
    top = CameraTop(build)
    write_files(
        folder,
        {
            **core_files(CAMERA_TOP, to_verilog(top, name=CAMERA_TOP, aliases=False), build),
            **bench_files(CAMERA_TOP, make_camera_bench(CAMERA_TOP, module_ports(top), build)),
            f"constraints/{CAMERA_TOP}.xdc": (SOURCES / "camera" / f"{CAMERA_TOP}.xdc").read_text(),
            "README.md": fill_readme(["camera/README.md"], build),
        },
        build,
    )
    write_host(folder / "host", build)


def core_files(name: str, verilog: str, build: Build) -> dict[str, str]:
    """The Verilog, and the register map as Markdown, CMSIS-SVD and C header, by path in the export."""
    registers = list_registers(build)
    return {
        f"rtl/{name}.v": verilog,
        "registers/register_map.md": register_docs.markdown(registers),
        f"registers/{TOP}.svd": register_docs.svd(registers),
        f"registers/{TOP}_registers.h": register_docs.c_header(registers),
    }


def bench_files(name: str, bench: VerilogBench) -> dict[str, str]:
    """The test bench and what FuseSoC needs to run it, by path in the export."""
    files = {f"sim/{file}": text for file, text in bench.files().items()}
    return {**files, f"{name}.core": core_file(name, [f"rtl/{name}.v"], list(files))}


def fill_readme(parts: Sequence[str], build: Build, **facts: str) -> str:
    """Join the parts of a README, and put the build and ``facts`` into its placeholders."""
    # str.format: literal braces in the Markdown are doubled.
    text = "".join((SOURCES / part).read_text() for part in parts)
    features = build.config.front_end.max_features
    return text.format(video=VIDEO[build.video_bits], features=features, **vars(build), **facts)


def _vivado_files(board: str, family: str, build: Build) -> dict[str, str]:
    """Scripts and constraints; ``board.tcl`` and ``system.tcl`` describe the board and its family."""
    files = {source.name: source.read_text() for source in (SOURCES / "vivado").iterdir()}
    files["system.tcl"] = (SOURCES / "systems" / f"{family}.tcl").read_text()
    facts = {
        "video_bits": build.video_bits,
        "core": ip_xact.VLNV,
        "core_version": ip_xact.CORE_VERSION,
        "core_revision": ip_xact.CORE_REVISION,
        "outputs": "{" + " ".join(build.outputs) + "}",
    }
    lines = [f"set board({name}) {value}\n" for name, value in facts.items()]
    files["board.tcl"] = "".join([(SOURCES / "boards" / f"{board}.tcl").read_text(), *lines])
    pins = SOURCES / "boards" / f"{board}.xdc"
    if pins.exists():
        files["bitstream_pins.xdc"] = pins.read_text()
    return {f"vivado/{name}": text for name, text in files.items()}
