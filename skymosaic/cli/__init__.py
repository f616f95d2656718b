"""The command line. Exit status: 0 done; 2 bad input; 3 the images could not be registered."""

from __future__ import annotations

import contextlib
import importlib
import sys
from typing import Any

import typer
from rich.console import Console
from typer.core import TyperGroup
from typer.main import get_command

from golden_model.text import one_line
from sim.backend import BackendError
from skymosaic.cli.terminal import abandon_output, ended_by_signals, without_library_messages
from skymosaic.errors import InputError, RegistrationError

COMMANDS = {
    "demo": ("demo", "Render a synthetic pair, make its mosaic, and compare it with the truth."),
    "mosaic": ("mosaic", "Make one mosaic of overlapping photographs: two, or a whole flight."),
    "check": ("check", "Check overlap, blur, exposure, GPS and weak links of a flight before you leave the site."),
    "live": ("live", "Grow a mosaic frame by frame, with a preview beside it."),
    "track": ("track", "Follow an object through a video."),
    "register": ("register", "Print the homography of two photographs, and how it was found."),
    "panel": ("panel", "Serve the front panel, a web page for this machine only."),
    "fuzzy": ("fuzzy", "Print the rules of the fuzzy systems, and draw them."),
    "thesis": ("thesis", "Repeat the thesis's experiments."),
    "export": ("export", "Write Verilog, Vivado scripts, register map and driver for a Xilinx kit."),
    "compare": ("compare", "Compare the hardware with the golden model on a pair of photographs."),
}
"""For each command its module in this folder and its line in ``skymosaic --help``."""


class _Commands(TyperGroup):
    """Imports a command only when it is called: most need OpenCV, some the hardware; ``--help`` needs neither."""

    def resolve_command(self, ctx: Any, args: list[str]) -> tuple[str | None, Any, list[str]]:
        """The command that the arguments name, and the arguments that are left."""
        name, command, rest = super().resolve_command(ctx, args)
        return name, _imported(name) if name in COMMANDS else command, rest


def _imported(name: str) -> Any:
    _check_opencv()
    single = typer.Typer(add_completion=False, pretty_exceptions_enable=False)
    single.command(name)(getattr(importlib.import_module(f"skymosaic.cli.{COMMANDS[name][0]}"), name))
    return get_command(single)


def _not_imported() -> None:
    raise AssertionError("replaced by the command itself before it is called")


app = typer.Typer(
    cls=_Commands,
    help="Overlapping UAV images in, one mosaic out.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)
for _name, (_, _summary) in COMMANDS.items():
    app.command(_name, help=_summary)(_not_imported)


def main() -> None:
    """Run the command line; every expected failure is one line and an exit status."""
    # The panel's log shows what its workers report.
    quiet = contextlib.nullcontext() if sys.argv[1:2] == ["panel"] else without_library_messages()
    with quiet, ended_by_signals():
        status = _run()
    sys.exit(status)


def _run() -> int | str | None:
    try:
        try:
            app()
        finally:
            # Now rather than at Python's end, where a full disk would be a traceback.
            sys.stdout.flush()
    except SystemExit as end:
        return end.code
    except (InputError, BackendError) as error:
        return _failed(str(error), 2)
    except RegistrationError as error:
        return _failed(str(error), 3)
    except MemoryError:
        return _failed("not enough memory; reduce the photographs, --memory or --scale", 2)
    except OSError as error:
        abandon_output()
        where = f"{error.filename}: " if error.filename else ""
        return _failed(f"{where}{error.strerror or error}; check the disk and its permissions", 2)
    return 0


def _failed(reason: str, status: int) -> int:
    console = Console(stderr=True)
    console.print(f"error: {one_line(reason)}", style="red", markup=False, highlight=False, soft_wrap=True)
    return status


def _check_opencv() -> None:
    """A package that pulls in another build of OpenCV overwrites ours, and pip does not notice."""
    cv2 = importlib.import_module("cv2")
    if not hasattr(cv2, "xfeatures2d"):
        raise InputError(
            f"OpenCV {cv2.__version__} lacks its contrib modules: another package replaced it; run "
            "pip install --force-reinstall --no-deps opencv-contrib-python-headless"
        )
