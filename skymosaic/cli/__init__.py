"""The command line. Exit status: 0 done; 2 bad input; 3 the images could not be registered."""

from __future__ import annotations

import sys

import typer

from sim.backend import BackendError
from skymosaic.cli import pair
from skymosaic.cli.options import console
from skymosaic.errors import InputError, RegistrationError

app = typer.Typer(
    help="Overlapping UAV images in, one mosaic out.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)
for command in (pair.demo, pair.mosaic, pair.register):
    app.command()(command)


def main() -> None:
    """Run the command line; every expected failure is one line and an exit status."""
    try:
        app()
    except (InputError, BackendError, RegistrationError) as error:
        console.print(f"error: {error}", style="red", markup=False, highlight=False, soft_wrap=True)
        sys.exit(3 if isinstance(error, RegistrationError) else 2)
