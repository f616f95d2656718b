"""The command line. Exit status: 0 done; 2 bad input; 3 the images could not be registered."""

from __future__ import annotations

import sys

import cv2
import typer

from sim.backend import BackendError
from skymosaic.cli import compare, export, flight, fuzzy, live, pair, panel, thesis, track
from skymosaic.cli.options import console
from skymosaic.errors import InputError, RegistrationError

app = typer.Typer(
    help="Overlapping UAV images in, one mosaic out.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)
for command in (
    pair.demo,
    flight.mosaic,
    flight.check,
    live.live,
    track.track,
    pair.register,
    panel.panel,
    fuzzy.fuzzy,
    thesis.thesis,
    export.export,
    compare.compare,
):
    app.command()(command)


def main() -> None:
    """Run the command line; every expected failure is one line and an exit status."""
    try:
        _check_opencv()
        app()
    except (InputError, BackendError, RegistrationError) as error:
        console.print(f"error: {error}", style="red", markup=False, highlight=False, soft_wrap=True)
        sys.exit(3 if isinstance(error, RegistrationError) else 2)


def _check_opencv() -> None:
    """A package that pulls in another build of OpenCV overwrites ours, and pip does not notice."""
    if not hasattr(cv2, "xfeatures2d"):
        raise InputError(
            f"OpenCV {cv2.__version__} lacks its contrib modules: another package replaced it; run "
            "pip install --force-reinstall --no-deps opencv-contrib-python-headless"
        )
