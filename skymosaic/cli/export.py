"""The command that writes everything for a Xilinx kit."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from hdl import export as hardware_export
from skymosaic.cli.options import ConfigOption, PresetOption, configuration, console
from skymosaic.errors import InputError


def export(
    *,
    board: Annotated[str, typer.Option(help=", ".join(hardware_export.BOARDS) + ".")],
    output: Annotated[Path, typer.Option("-o", "--output", help="Folder to write.")],
    preset: PresetOption = "aerial",
    config: ConfigOption = None,
    lanes: Annotated[int, typer.Option(help="Descriptors compared at a time, a power of two.")] = 16,
    max_width_px: Annotated[int, typer.Option("--max-width", help="Widest frame.")] = 1920,
    max_height_px: Annotated[int, typer.Option("--max-height", help="Highest frame.")] = 1080,
) -> None:
    """Write Verilog, Vivado scripts, constraints, register map and board driver for a Xilinx kit."""
    build = {"lanes": lanes, "max_width_px": max_width_px, "max_height_px": max_height_px}
    with console.status("writing Verilog"):
        try:
            hardware_export.export(output, board=board, config=configuration(preset, config), **build)
        except ValueError as error:
            raise InputError(str(error)) from None
        except OSError as error:
            raise InputError(f"{output}: cannot be written ({error.strerror}); choose another folder") from None
    console.print(f"wrote {output}; its README.md tells the next steps")
