"""The command that writes everything for a kit."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from golden_model.config import Config
from hdl.export.boards import ALL_BOARDS, SERIAL_BOARD
from skymosaic.cli.options import OverwriteOption, choice, with_options
from skymosaic.cli.session import session
from skymosaic.errors import InputError
from skymosaic.fuzzy.fll import load_system
from skymosaic.fuzzy.golden import ENTRIES, quantise
from skymosaic.imagery.images import check_unused
from skymosaic.registration.options import FeatureOptions
from skymosaic.temporary import temporary_folder

BUILD = {"lanes": 16, "max_width_px": 1920, "max_height_px": 1080, "video_bits": 32}
"""The accelerator's build, unless asked for another one."""
LIVE_BUILD = BUILD | {"video_bits": 24}


@with_options
def export(
    *,
    board: Annotated[str | None, choice(ALL_BOARDS, "The kit.")] = None,
    block: Annotated[str | None, typer.Option(help="One block with a test bench, instead of all: harris, ...")] = None,
    live: Annotated[bool, typer.Option("--live", help="For a camera: packets of every frame go to memory.")] = False,
    output: Annotated[Path, typer.Option("-o", "--output", help="Folder to write.")],
    overwrite: OverwriteOption = False,
    options: Annotated[FeatureOptions, ("preset", "config")],
    lanes: Annotated[
        int | None, typer.Option(help="Descriptors compared at a time, a power of two: usually 16, on the ulx3s 4.")
    ] = None,
    max_width_px: Annotated[
        int | None, typer.Option("--max-width", help="Widest frame: usually 1920, on the ulx3s 320.")
    ] = None,
    max_height_px: Annotated[
        int | None, typer.Option("--max-height", help="Highest frame: usually 1080, on the ulx3s 240.")
    ] = None,
    video_bits: Annotated[
        int | None,
        typer.Option(
            help="Video input: 32 bits for a DMA (usual for a board), 24 RGB (usual live), 8 gray; two pixels a clock: "
            "48 RGB, 16 gray."
        ),
    ] = None,
    build_it: Annotated[
        bool, typer.Option("--build", help=f"With --board {SERIAL_BOARD}: make the bitstream, too.")
    ] = False,
    rules: Annotated[Path | None, typer.Option(help="With --block fuzzy: your own system, an .fll file.")] = None,
    entries: Annotated[int, typer.Option(min=2, help="With --rules: table entries of each input.")] = ENTRIES,
) -> None:
    """Write Verilog, register map and more: for a kit with its driver, for a live camera, or of one block."""
    if (board is not None) + (block is not None) + live != 1:
        raise InputError(f"export needs one of --board ({', '.join(ALL_BOARDS)}), --block and --live")
    sizes = {"lanes": lanes, "max_width_px": max_width_px, "max_height_px": max_height_px, "video_bits": video_bits}
    asked = {name: value for name, value in sizes.items() if value is not None}
    build = (LIVE_BUILD if live else BUILD) | asked
    if build_it and board != SERIAL_BOARD:
        raise InputError(f"--build makes the bitstream of --board {SERIAL_BOARD}; leave it out, or use Vivado")
    if block is not None and (asked or options != FeatureOptions()):
        raise InputError("--block takes no option of the whole accelerator (--lanes, --preset, ...); leave it out")
    _check_rules(block, rules, entries)
    check_unused(output, overwrite=overwrite)
    # All of these load Amaranth, which --help need not wait for.
    write: Callable[[Path], None]
    if rules is not None:
        write = partial(_export_rules, rules=rules, entries=entries)
    elif block is not None:
        write = partial(_export_block, name=block)
    elif board == SERIAL_BOARD:
        own = None if options == FeatureOptions() else options.base_config
        write = partial(_export_serial, config=own, build=asked, build_it=build_it)
    else:
        write = partial(_export_accelerator, board=board, config=options.base_config, build=build)
    with session.working("writing Verilog"):
        _write_whole(output, write)
    session.wrote(output)
    session.show(f"wrote {output}; its README.md tells the next steps")


def _check_rules(block: str | None, rules: Path | None, entries: int) -> None:
    """Refuse options of the block fuzzy without it."""
    if rules is not None and block != "fuzzy":
        raise InputError(f"--rules {rules} makes the block fuzzy; add --block fuzzy, or leave it out")
    if rules is None and entries != ENTRIES:
        raise InputError("--entries is the length of the tables of --rules; add these, or leave it out")


def _write_whole(output: Path, write: Callable[[Path], None]) -> None:
    """Have a folder written complete, or not at all: beside its place, and then moved there."""
    try:
        with temporary_folder(_existing(output.absolute().parent)) as folder:
            made = folder / "export"
            write(made)
            for path in sorted(path for path in made.rglob("*") if path.is_file()):
                target = output / path.relative_to(made)
                target.parent.mkdir(parents=True, exist_ok=True)
                path.replace(target)
    except ValueError as error:
        raise InputError(str(error)) from None
    except OSError as error:
        raise InputError(f"{output}: cannot be written ({error.strerror}); choose another folder") from None


def _export_block(folder: Path, name: str) -> None:
    """Write one block of the accelerator."""
    importlib.import_module("hdl.blocks.export").export_block(folder, name)


def _export_accelerator(folder: Path, board: str | None, config: Config, build: dict[str, int]) -> None:
    """Write the accelerator for a board with a processor; without a board, that for a live camera."""
    exports = importlib.import_module("hdl.export.accelerator")
    if board is None:
        exports.export_live(folder, config=config, **build)
    else:
        exports.export(folder, board=board, config=config, **build)


def _export_rules(folder: Path, rules: Path, entries: int) -> None:
    """Write the block of a system from a file."""
    system = load_system(rules)
    try:
        made = importlib.import_module("skymosaic.fuzzy.verilog").make_block(quantise(system, entries))
    except ValueError as error:
        raise InputError(f"{rules}: cannot be made of hardware: {error}") from None
    importlib.import_module("hdl.blocks.export").write_block(folder, "fuzzy", made)


def _export_serial(folder: Path, config: Config | None, build: dict[str, int], *, build_it: bool) -> None:
    """Write the folder of the board with a serial port; None is its own configuration."""
    serial = importlib.import_module("hdl.export.ulx3s")
    serial.export_ulx3s(folder, **({} if config is None else {"config": config}), **build)
    if not build_it:
        return
    session.tell("building the bitstream, about a quarter of an hour")
    try:
        made = serial.build_bitstream(folder, tell=lambda tool: session.tell(f"running {tool}"))
    except serial.BuildError as error:
        raise InputError(str(error)) from None
    (length, mhz), used = (made.pop("bytes"), made.pop("clock_mhz")), made
    told = ", ".join(f"{name} {count} of {available}" for name, (count, available) in used.items())
    session.show(f"bitstream of {length} bytes; {mhz} MHz reached, 25 needed; {told}")


def _existing(folder: Path) -> Path:
    return folder if folder.exists() else _existing(folder.parent)
