"""The command that writes everything for a Xilinx kit."""

from __future__ import annotations

import importlib
from pathlib import Path
from typing import Annotated

import typer

from hdl.boards import BOARDS
from skymosaic.cli.options import ConfigOption, OverwriteOption, PresetOption, choice, configuration
from skymosaic.cli.session import session
from skymosaic.errors import InputError
from skymosaic.fuzzy.files import load_system
from skymosaic.fuzzy.golden import ENTRIES, quantised
from skymosaic.imagery.images import check_unused
from skymosaic.temporary import temporary_folder

BUILD = {"lanes": 16, "max_width_px": 1920, "max_height_px": 1080, "video_bits": 32}
"""The accelerator's build, unless asked for another one."""
LIVE_VIDEO_BITS = 24
"""Of a live build, unless asked for another one."""


def export(
    *,
    board: Annotated[str | None, choice(BOARDS, "The kit.")] = None,
    block: Annotated[str | None, typer.Option(help="One block with a test bench, instead of all: harris, ...")] = None,
    live: Annotated[bool, typer.Option("--live", help="For a camera: packets of every frame go to memory.")] = False,
    output: Annotated[Path, typer.Option("-o", "--output", help="Folder to write.")],
    overwrite: OverwriteOption = False,
    preset: PresetOption = "aerial",
    config: ConfigOption = None,
    lanes: Annotated[int, typer.Option(help="Descriptors compared at a time, a power of two.")] = BUILD["lanes"],
    max_width_px: Annotated[int, typer.Option("--max-width", help="Widest frame.")] = BUILD["max_width_px"],
    max_height_px: Annotated[int, typer.Option("--max-height", help="Highest frame.")] = BUILD["max_height_px"],
    video_bits: Annotated[
        int | None,
        typer.Option(
            help="Video input: 32 bits for a DMA (usual for a board), 24 RGB (usual live), 8 gray; two pixels a clock: "
            "48 RGB, 16 gray."
        ),
    ] = None,
    rules: Annotated[
        Path | None, typer.Option(help="With --block fuzzy: your own system, an .fll or .fcl file.")
    ] = None,
    entries: Annotated[int, typer.Option(min=2, help="With --rules: table entries of each input.")] = ENTRIES,
) -> None:
    """Write Verilog, register map and more: for a Xilinx kit with its driver, for a live camera, or of one block."""
    if (board is not None) + (block is not None) + live != 1:
        raise InputError(f"export needs one of --board ({', '.join(BOARDS)}), --block and --live")
    if video_bits is None:
        video_bits = LIVE_VIDEO_BITS if live else BUILD["video_bits"]
    build = {"lanes": lanes, "max_width_px": max_width_px, "max_height_px": max_height_px, "video_bits": video_bits}
    if block is not None and (build != BUILD or preset != "aerial" or config is not None):
        raise InputError("--block takes no option of the whole accelerator (--lanes, --preset, ...); leave it out")
    if rules is not None and block != "fuzzy":
        raise InputError(f"--rules {rules} makes the block fuzzy; add --block fuzzy, or leave it out")
    if rules is None and entries != ENTRIES:
        raise InputError("--entries is the length of the tables of --rules; add these, or leave it out")
    check_unused(output, overwrite=overwrite)
    with session.working("writing Verilog"):
        try:
            # Complete, or not at all: written beside the folder and then moved into it.
            with temporary_folder(_existing(output.absolute().parent)) as folder:
                made = folder / "export"
                # All four load Amaranth, which --help need not wait for.
                if rules is not None:
                    _export_rules(made, rules, entries)
                elif block is not None:
                    importlib.import_module("hdl.blocks.export").export_block(made, block)
                elif live:
                    importlib.import_module("hdl.export").export_live(
                        made, config=configuration(preset, config), **build
                    )
                else:
                    importlib.import_module("hdl.export").export(
                        made, board=board, config=configuration(preset, config), **build
                    )
                for path in sorted(path for path in made.rglob("*") if path.is_file()):
                    target = output / path.relative_to(made)
                    target.parent.mkdir(parents=True, exist_ok=True)
                    path.replace(target)
        except ValueError as error:
            raise InputError(str(error)) from None
        except OSError as error:
            raise InputError(f"{output}: cannot be written ({error.strerror}); choose another folder") from None
    session.wrote(output)
    session.show(f"wrote {output}; its README.md tells the next steps")


def _export_rules(folder: Path, rules: Path, entries: int) -> None:
    """Write the block of a system from a file."""
    system = load_system(rules)
    try:
        made = importlib.import_module("skymosaic.fuzzy.verilog").block(quantised(system, entries))
    except ValueError as error:
        raise InputError(f"{rules}: cannot be made of hardware: {error}") from None
    importlib.import_module("hdl.blocks.export").write_block(folder, "fuzzy", made)


def _existing(folder: Path) -> Path:
    return folder if folder.exists() else _existing(folder.parent)
