"""The command that exports Verilog, register map and drivers."""

import dataclasses
import importlib
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Annotated, Any

import typer

from golden_model.config import EstimatorConfig
from golden_model.fuzzy.fll import load_system
from hdl.build import BUILDS, Build
from hdl.export.boards import ALL_BOARDS, SERIAL_BOARD
from skymosaic.cli.options import OverwriteOption, choice, output_option, read_file, read_rules, with_options
from skymosaic.cli.session import session
from skymosaic.common.errors import InputError
from skymosaic.common.options import HARDWARE, OUTPUT
from skymosaic.common.temporary import existing_parent, temporary_folder
from skymosaic.fuzzy.golden import ENTRIES, quantise
from skymosaic.imagery.images import check_unused
from skymosaic.registration.options import FeatureOptions


@with_options
def export(
    *,
    board: Annotated[str | None, choice(ALL_BOARDS, "The kit.")] = None,
    block: Annotated[
        str | None,
        typer.Option(help="One block with a test bench, instead of all: harris, ..., or MODULE:CLASS of your own."),
    ] = None,
    live: Annotated[bool, typer.Option("--live", help="For a camera: packets of every frame go to memory.")] = False,
    homography: Annotated[
        bool,
        typer.Option(
            "--homography",
            rich_help_panel=HARDWARE,
            help="The chip estimates a homography for every frame, too.",
        ),
    ] = False,
    output: Annotated[Path, output_option("Folder to write.")],
    overwrite: OverwriteOption = False,
    options: Annotated[FeatureOptions, ("preset", "config")],
    rules: Annotated[
        str | None,
        typer.Option(
            help="Fuzzy rules that decide matches: aerial, ilbp, none, or an .fll file; with --block fuzzy "
            "any system in one."
        ),
    ] = None,
    lanes: Annotated[
        int | None,
        typer.Option(
            rich_help_panel=HARDWARE,
            help="Descriptors compared at a time, a power of two.",
        ),
    ] = None,
    max_width_px: Annotated[
        int | None,
        typer.Option(
            "--max-width",
            rich_help_panel=HARDWARE,
            help="Widest frame.",
        ),
    ] = None,
    max_height_px: Annotated[
        int | None,
        typer.Option(
            "--max-height",
            rich_help_panel=HARDWARE,
            help="Tallest frame.",
        ),
    ] = None,
    video_bits: Annotated[
        int | None,
        typer.Option(
            rich_help_panel=HARDWARE,
            help="Video input: 32 bits for a DMA (usual for a board), 24 RGB (usual live), 8 gray; with two pixels "
            "per clock 48 RGB, 16 gray.",
        ),
    ] = None,
    build_it: Annotated[
        bool,
        typer.Option("--build", rich_help_panel=OUTPUT, help=f"With --board {SERIAL_BOARD}: make the bitstream, too."),
    ] = False,
    entries: Annotated[
        int, typer.Option(min=2, rich_help_panel=HARDWARE, help="With --block fuzzy: table entries of each input.")
    ] = ENTRIES,
) -> None:
    """Write Verilog, register map and more: for a kit with its driver, for a live camera, or of one block."""
    if (board is not None) + (block is not None) + live != 1:
        raise InputError(f"export needs one of --board ({', '.join(ALL_BOARDS)}), --block and --live")
    sizes = {"lanes": lanes, "max_width_px": max_width_px, "max_height_px": max_height_px, "video_bits": video_bits}
    changes: dict[str, Any] = {name: value for name, value in sizes.items() if value is not None}
    if build_it and board != SERIAL_BOARD:
        raise InputError(f"--build makes the bitstream of --board {SERIAL_BOARD}; leave it out, or use Vivado")
    if block is not None and (changes or options != FeatureOptions()):
        raise InputError("--block takes no option of the whole accelerator (--lanes, --preset, ...); leave it out")
    if rules is not None and block not in (None, "fuzzy"):
        raise InputError(f"--rules {rules}: of the blocks, only fuzzy has rules; add --block fuzzy, or leave it out")
    if block != "fuzzy" and entries != ENTRIES:
        raise InputError("--entries is the length of the tables of --block fuzzy; add it, or leave it out")
    if rules is not None and block is None:
        options = dataclasses.replace(options, rules=read_rules(rules))
        options.check()
    if homography and (block is not None or board == SERIAL_BOARD):
        raise InputError(f"--homography needs --live or a --board other than {SERIAL_BOARD}; leave it out")
    check_unused(output, overwrite=overwrite)

    usual = BUILDS["camera"] if live else BUILDS.get(board or "", Build())
    if options == FeatureOptions(rules=options.rules):
        # The board has a configuration of its own, which only an explicit one replaces.
        options = dataclasses.replace(options, config=usual.config)
    config = dataclasses.replace(options.base_config, estimator=EstimatorConfig() if homography else None)
    try:
        build = dataclasses.replace(usual, config=config, **changes)
    except ValueError as error:
        raise InputError(str(error)) from None

    def write(folder: Path) -> None:
        if rules is not None and block is not None:
            _export_rules(folder, Path(rules), entries)
        elif block is not None:
            # A module of one's own lies in the folder where the command is called.
            sys.path.insert(0, str(Path.cwd()))
            _import_hdl("blocks.export").export_block(folder, block)
        elif board is None:
            _import_hdl("export.accelerator").export_camera(folder, build)
        elif board == SERIAL_BOARD:
            _export_serial(folder, build, build_it=build_it)
        else:
            _import_hdl("export.accelerator").export_board(folder, board, build)

    with session.working("writing Verilog"):
        _write_completely(output, write)
    session.wrote(output)
    has_readme = (output / "README.md").exists()
    session.show(f"wrote {output}" + ("; its README.md lists the next steps" if has_readme else ""))


def _write_completely(output: Path, write: Callable[[Path], None]) -> None:
    """Have a folder written complete or not at all: beside its place, and then moved there."""
    try:
        with temporary_folder(existing_parent(output)) as folder:
            export_folder = folder / "export"
            write(export_folder)
            for path in sorted(path for path in export_folder.rglob("*") if path.is_file()):
                target = output / path.relative_to(export_folder)
                target.parent.mkdir(parents=True, exist_ok=True)
                path.replace(target)
    except ValueError as error:
        raise InputError(str(error)) from None
    except OSError as error:
        raise InputError(f"{output}: cannot be written ({error.strerror}); choose another folder") from None


def _import_hdl(name: str) -> ModuleType:
    """Import a module that loads Amaranth, for which ``--help`` need not wait."""
    return importlib.import_module(f"hdl.{name}")


def _export_rules(folder: Path, rules: Path, entries: int) -> None:
    """Write the block of a system from a file."""
    system = read_file(load_system, rules)
    try:
        block = importlib.import_module("skymosaic.fuzzy.verilog").make_block(quantise(system, entries))
    except ValueError as error:
        raise InputError(f"{rules}: cannot be made of hardware: {error}") from None
    _import_hdl("blocks.export").write_block(folder, "fuzzy", block)


def _export_serial(folder: Path, build: Build, *, build_it: bool) -> None:
    """Write the folder of the board with a serial port, and its bitstream where that is asked for."""
    serial = _import_hdl("export.ulx3s")
    serial.export_ulx3s(folder, build)
    if not build_it:
        return
    session.tell("building the bitstream, about a quarter of an hour")
    try:
        numbers = serial.build_bitstream(folder, tell=lambda tool: session.tell(f"running {tool}"))
    except serial.BuildError as error:
        raise InputError(str(error)) from None
    length, mhz = numbers.pop("bytes"), numbers.pop("clock_mhz")
    cells = ", ".join(f"{name} {count} of {available}" for name, (count, available) in numbers.items())
    session.show(f"bitstream of {length} bytes; {mhz} MHz reached, 25 needed; {cells}")
