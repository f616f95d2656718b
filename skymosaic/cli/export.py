"""The commands that export Verilog, register map and drivers."""

import importlib
import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from difflib import get_close_matches
from pathlib import Path
from types import ModuleType
from typing import Annotated

import typer

from golden_model.config import EstimatorConfig
from golden_model.fuzzy.fll import load_system
from golden_model.temporary import temporary_folder
from hdl.build import BUILDS, Build
from hdl.export.boards import ALL_BOARDS, SERIAL_BOARD, check_board
from hdl.export.tools import BuildError
from skymosaic.cli.options import OutputVariableOption, OverwriteOption, output_option, read_file
from skymosaic.cli.outputs import Writes
from skymosaic.cli.session import session
from skymosaic.common.errors import InputError
from skymosaic.common.options import HARDWARE, OUTPUT, option
from skymosaic.common.temporary import existing_parent
from skymosaic.fuzzy.quantised import ENTRIES, quantise
from skymosaic.imagery.images import check_unused
from skymosaic.registration.options import ConfigOptions

SIZES = ("lanes", "max_width_px", "max_height_px", "video_bits")


def _usual(name: str) -> str:
    return f"usually {getattr(Build, name)}, on the {SERIAL_BOARD} {getattr(BUILDS[SERIAL_BOARD], name)}."


@dataclass(frozen=True, kw_only=True)
class BuildOptions(ConfigOptions):
    """What is built otherwise than usual for the board."""

    homography: bool = option(False, "The chip estimates a homography for every frame, too.", HARDWARE)
    lanes: int | None = option(None, f"Descriptors compared at a time: {_usual('lanes')}", HARDWARE)
    max_width_px: int | None = option(None, f"Widest frame: {_usual('max_width_px')}", HARDWARE)
    max_height_px: int | None = option(None, f"Tallest frame: {_usual('max_height_px')}", HARDWARE)
    video_bits: int | None = option(
        None,
        "Bits of the video input, 32 for a DMA, 24 RGB, 8 gray, with two pixels per clock 48 RGB and 16 gray: "
        f"{_usual('video_bits')}",
        HARDWARE,
    )

    def build(self, usual: Build) -> Build:
        """The ``usual`` build with what is asked for instead."""
        # A board may have a configuration of its own, which only an explicit one replaces.
        own = usual.config if self.preset == usual.config.preset else None
        config = replace(self, config=self.config or own).base_config
        estimator = EstimatorConfig() if self.homography else None
        changes = {name: size for name in SIZES if (size := getattr(self, name)) is not None}
        try:
            return replace(usual, config=replace(config, estimator=estimator), **changes)
        except ValueError as error:
            raise InputError(str(error)) from None


@dataclass(frozen=True, kw_only=True)
class CameraOptions(BuildOptions):
    """What is built otherwise than usual behind a camera."""

    video_bits: int | None = option(
        None, f"Bits of the camera's video, 24 RGB or 8 gray: usually {BUILDS['camera'].video_bits}.", HARDWARE
    )
    painter: bool = option(False, "With --homography: the chip paints frames onto a canvas in memory.", HARDWARE)

    def build(self, usual: Build) -> Build:
        """The ``usual`` build with what is asked for instead."""
        if self.painter and not self.homography:
            raise InputError("--painter paints frames where their homographies say; add --homography")
        return replace(super().build(usual), painter=self.painter)


OWN_NAMES = (
    r"LICENSE|NOTICE|README\.md|config\.toml|test_\w+\.py|[\w.-]+\.(core|hex|lpf|v|xml)"
    r"|build|constraints|host|litex|pynq|registers|rtl|sim|vivado"
)
"""Regular expression of the names in an export's folder."""
FolderOption = Annotated[Path, output_option("Folder to write."), Writes(OWN_NAMES)]
ModuleOption = Annotated[str | None, typer.Option("--name", help="Name of the Verilog module and of its core.")]


def board(
    *,
    name: Annotated[
        str, typer.Argument(help="The kit.", metavar="|".join(ALL_BOARDS), autocompletion=lambda: list(ALL_BOARDS))
    ],
    output: FolderOption,
    overwrite: OverwriteOption = False,
    options: BuildOptions,
    bitstream: Annotated[
        bool, typer.Option("--build", rich_help_panel=OUTPUT, help=f"For the {SERIAL_BOARD}: make the bitstream, too.")
    ] = False,
) -> None:
    """Write Verilog, register map, driver and what the tools need, for a kit."""
    if name not in ALL_BOARDS and (near := get_close_matches(name, ALL_BOARDS, 1)):
        raise InputError(f"unknown board {name!r}; did you mean {near[0]}?")
    read_file(check_board, name)
    if bitstream and name != SERIAL_BOARD:
        raise InputError(f"--build makes the bitstream of the {SERIAL_BOARD}; leave it out, or use Vivado")
    build = options.build(BUILDS.get(name, Build()))

    def write(folder: Path) -> None:
        if name != SERIAL_BOARD:
            _import_hdl("export.accelerator").export_board(folder, name, build)
            return
        _import_hdl("export.ulx3s").export_ulx3s(folder, build)
        if bitstream:
            _make_bitstream(folder)

    _export(output, write, overwrite=overwrite)


def camera(*, output: FolderOption, overwrite: OverwriteOption = False, options: CameraOptions) -> None:
    """Write Verilog, register map and reader for a camera: packets of every frame go to memory, without software."""
    build = options.build(BUILDS["camera"])
    _export(output, lambda folder: _import_hdl("export.accelerator").export_camera(folder, build), overwrite=overwrite)


def block(
    *,
    name: Annotated[str, typer.Argument(help="harris, fast, ..., or MODULE:CLASS of your own.")],
    output: FolderOption,
    overwrite: OverwriteOption = False,
    settings: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="NAME=VALUE", rich_help_panel=HARDWARE, help="As in `width_px=640`."),
    ] = None,
    model: Annotated[
        str | None, typer.Option(metavar="MODULE:FUNCTION", help="Golden model of your own class: records in and out.")
    ] = None,
    module: ModuleOption = None,
    area: Annotated[
        bool, typer.Option("--area", help="Say, too, what it takes of a Xilinx FPGA of series 7, by Yosys.")
    ] = False,
) -> None:
    """Write Verilog and test benches of one block."""
    pairs = [each.partition("=") for each in settings or ()]
    for key, separator, value in pairs:
        if not key or not value:
            raise InputError(f"--set {key}{separator}{value}: give NAME=VALUE, as in --set width_px=640")
    # A module of one's own lies in the folder where the command is called.
    sys.path.insert(0, str(Path.cwd()))
    blocks = _import_hdl("blocks.export")
    usual, found = read_file(blocks.find_block, name, {key: value for key, _, value in pairs}, model)

    def write(folder: Path) -> None:
        blocks.write_block(folder, module or usual, found, name)
        if area:
            sizes.append(_import_hdl("export.area").describe_area(found.component))

    sizes: list[str] = []
    _export(output, write, overwrite=overwrite)
    for each in sizes:
        session.show(each)
    if not found.outputs:
        session.note("without a golden model there is no test bench; give one by --model MODULE:FUNCTION")


def fuzzy(
    *,
    file: Annotated[Path, typer.Argument(help="Zero-order Sugeno system, an .fll or .fis file.")],
    output: FolderOption,
    overwrite: OverwriteOption = False,
    entries: Annotated[int, typer.Option(min=2, help="Table entries of each input.")] = ENTRIES,
    output_variable: OutputVariableOption = None,
    module: ModuleOption = None,
) -> None:
    """Write Verilog and test benches of a fuzzy system of your own."""
    system = read_file(load_system, file, output_variable)

    def write(folder: Path) -> None:
        verilog = importlib.import_module("skymosaic.fuzzy.verilog")
        try:
            made = verilog.make_block(quantise(system, entries))
        except ValueError as error:
            raise InputError(f"{file}: cannot be made of hardware: {error}") from None
        usual = verilog.identifier(f"fuzzy_{system.name or file.stem}")
        _import_hdl("blocks.export").write_block(folder, module or usual, made, (system, entries))

    _export(output, write, overwrite=overwrite)


export = {"board": board, "camera": camera, "block": block, "fuzzy": fuzzy}


def _export(output: Path, write: Callable[[Path], None], *, overwrite: bool) -> None:
    """Have a folder written complete or not at all: beside its place, and then moved there."""
    check_unused(output, overwrite=overwrite)
    try:
        with session.working("writing Verilog"), temporary_folder(existing_parent(output)) as temporary:
            folder = temporary / "export"
            write(folder)
            # Another export may have ended meanwhile.
            check_unused(output, overwrite=overwrite)
            for path in sorted(path for path in folder.rglob("*") if path.is_file()):
                target = output / path.relative_to(folder)
                target.parent.mkdir(parents=True, exist_ok=True)
                path.replace(target)
    except (ValueError, BuildError) as error:
        raise InputError(str(error)) from None
    except OSError as error:
        raise InputError(f"{output}: cannot be written ({error.strerror}); choose another folder") from None
    session.wrote(output)
    has_readme = (output / "README.md").exists()
    session.show(f"wrote {output}" + ("; its README.md lists the next steps" if has_readme else ""))


def _import_hdl(name: str) -> ModuleType:
    """Import a module that loads Amaranth, for which ``--help`` need not wait."""
    return importlib.import_module(f"hdl.{name}")


def _make_bitstream(folder: Path) -> None:
    """Run the open tools in the folder of an export, and show what they reached."""
    ulx3s = _import_hdl("export.ulx3s")
    session.tell("building the bitstream, about a quarter of an hour")
    numbers = ulx3s.build_bitstream(folder, tell=lambda tool: session.tell(f"running {tool}"))
    length, mhz = numbers.pop("bytes"), numbers.pop("clock_mhz")
    cells = ", ".join(f"{name} {count} of {available}" for name, (count, available) in numbers.items())
    session.show(f"bitstream of {length} bytes; {mhz} MHz reached, 25 needed; {cells}")
