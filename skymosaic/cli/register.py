"""The command that registers a pair of photographs."""

from pathlib import Path
from typing import Annotated

import typer

from skymosaic.cli.options import print_pair
from skymosaic.cli.session import session
from skymosaic.common.errors import RegistrationError
from skymosaic.common.options import respell
from skymosaic.registration.options import RegistrationOptions
from skymosaic.registration.register import register as register_pair


def register(
    *,
    left: Annotated[Path, typer.Argument(help="Left photograph.")],
    right: Annotated[Path, typer.Argument(help="Right photograph.")],
    options: RegistrationOptions,
) -> None:
    """Print the homography that maps LEFT pixels to RIGHT pixels, and how it was found."""
    with session.working("registering") as step:
        pair = register_pair(left, right, options, progress=step)
        session.numbers = {**pair.summary(), "reason": respell(pair.reason)}
    session.seconds = pair.seconds
    if pair.homography is not None:
        print_pair(pair)
        for row in pair.homography:
            session.show("  ".join(f"{value: .9e}" for value in row))
    if not pair.accepted:
        raise RegistrationError(f"{left} and {right} cannot be registered: {pair.reason}")
