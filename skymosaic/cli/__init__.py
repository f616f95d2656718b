"""The command line. docs/how-to/command_line.md says what all commands have in common, and what exit statuses mean."""

import contextlib
import importlib
import sys
from collections.abc import Callable
from typing import Annotated, Any

import typer
from typer.core import TyperGroup
from typer.main import get_command

from golden_model.version import VERSION
from sim.backends.errors import BackendError
from skymosaic.cli.common import QuietOption, VerboseOption, with_common_options
from skymosaic.cli.completion import sketch
from skymosaic.cli.session import session
from skymosaic.cli.terminal import abandon_output, ended_by_signals, open_outputs, without_library_messages
from skymosaic.common.errors import InputError, RegistrationError

COMMANDS = {
    "demo": "Render a synthetic pair, make its mosaic, and compare it with the truth.",
    "mosaic": "Make one mosaic of overlapping photographs: two, or a whole flight.",
    "check": "Check overlap, blur, exposure, GPS and weak links of a flight before you leave the site.",
    "live": "Grow a mosaic frame by frame, with a preview beside it.",
    "track": "Follow an object through a video.",
    "register": "Print the homography of two photographs, and how it was found.",
    "panel": "Serve the front panel, a web page for this machine only.",
    "fuzzy": "Print the rules of the fuzzy systems, and draw them.",
    "thesis": "Repeat the thesis's experiments.",
    "export": "Write Verilog and more: for a board, for a camera, of one block, or of a fuzzy system.",
    "compare": "Compare the hardware with the golden model on a pair of photographs.",
}
"""Each command, which is a function of the same name in the module of that name, and its line in the help.

A dictionary in place of the function holds commands of the command's own.
"""


PIPE_CLOSED = 128 + 13
"""Exit status where the reader of standard output has gone: as of a program that SIGPIPE ends."""


class _Commands(TyperGroup):
    """Imports a command only when it is called: most need OpenCV, some the hardware; ``--help`` needs neither."""

    def resolve_command(self, ctx: Any, args: list[str]) -> tuple[str | None, Any, list[str]]:
        """The command that the arguments name, and the arguments that are left."""
        name, command, rest = super().resolve_command(ctx, args)
        if name not in COMMANDS:
            return name, command, rest
        # The shell asks what could follow.
        return name, sketch(name) if ctx.resilient_parsing else _import_command(name, ctx.params), rest


def _import_command(name: str, before: dict[str, bool]) -> Any:
    # Before the command's module, which would fail with a traceback.
    _check_opencv()
    made = typer.Typer(add_completion=False, pretty_exceptions_enable=False, help=COMMANDS[name])
    functions = import_functions(name, before)
    for words, function in functions.items():
        made.command(words.split()[-1])(function)
    if name not in functions:
        made.callback(invoke_without_command=True)(_require_command)
    return get_command(made)


def import_functions(name: str, before: dict[str, bool]) -> dict[str, Callable[..., None]]:
    """The function of a command, or of each command of a group, with the common options, by the words that call it."""
    command = getattr(importlib.import_module(f"skymosaic.cli.{name}"), name)
    own = (
        {f"{name} {each}": function for each, function in command.items()}
        if isinstance(command, dict)
        else {name: command}
    )
    return {words: with_common_options(words, function, before) for words, function in own.items()}


def _require_command(context: typer.Context) -> None:
    if context.invoked_subcommand is None:
        group: Any = context.command
        valid = ", ".join(group.commands)
        raise InputError(f"{context.info_name} needs one of {valid}; run {context.command_path} --help")


def _replaced() -> None:
    raise AssertionError("a placeholder: the command itself is imported before it is called")


def _print_version(asked: bool) -> None:
    if asked:
        typer.echo(f"skymosaic {VERSION}")
        raise typer.Exit


app = typer.Typer(
    cls=_Commands,
    help="Overlapping UAV images in, one mosaic out.",
    pretty_exceptions_enable=False,
    # Rich would triple the time that the help takes.
    rich_markup_mode=None,
)
for _name, _summary in COMMANDS.items():
    app.command(_name, short_help=_summary)(_replaced)


@app.callback(invoke_without_command=True)
def _before_the_command(
    context: typer.Context,
    *,
    quiet: QuietOption = False,
    verbose: VerboseOption = False,
    _version: Annotated[
        bool, typer.Option("--version", is_eager=True, callback=_print_version, help="Print the version.")
    ] = False,
) -> None:
    """The options before a command's name are handed to the command, see `_Commands`."""
    del quiet, verbose
    if context.invoked_subcommand is None:
        # As for any other unusable command line, the status is not 0: a script may have lost the command's name.
        typer.echo(context.get_help())
        raise typer.Exit(2)


def main() -> None:
    """Run the command line; every expected failure is one line and an exit status."""
    open_outputs()
    # The panel's log shows what its workers report.
    noisy = sys.argv[1:2] == ["panel"] or {"-v", "--verbose"}.intersection(sys.argv)
    with contextlib.nullcontext() if noisy else without_library_messages(), ended_by_signals():
        status = _run()
    sys.exit(status)


def _run() -> int | str | None:
    try:
        try:
            # Standalone, Click would print its errors in several lines and end the process.
            status: int | None = app(prog_name="skymosaic", standalone_mode=False)
        finally:
            # Now rather than at Python's end, where a full disk would be a traceback.
            sys.stdout.flush()
    except (SystemExit, BrokenPipeError) as end:
        return _status_of(end)
    except typer.TyperException as error:
        return _fail(_describe_usage(error), 2)
    except (InputError, BackendError, RegistrationError) as error:
        return _fail(str(error), 3 if isinstance(error, RegistrationError) else 2)
    except MemoryError:
        return _fail("not enough memory; reduce the photographs, --memory or --scale", 2)
    except OSError as error:
        # A full disk.
        abandon_output()
        where = f"{error.filename}: " if error.filename else ""
        return _fail(f"{where}{error.strerror or error}; check the disk and its permissions", 2)
    return status


def _status_of(end: SystemExit | BrokenPipeError) -> int | str | None:
    # Click makes a closed pipe a silent 1, which is the status of `compare` for a difference.
    if isinstance(end, SystemExit) and not isinstance(end.__context__, BrokenPipeError):
        return end.code
    abandon_output()
    return PIPE_CLOSED


def _describe_usage(error: typer.TyperException) -> str:
    """What is wrong with the command line, and which help explains it."""
    context = getattr(error, "ctx", None)
    command = context.command_path if context else "skymosaic"
    return f"{' '.join(error.format_message().split()).rstrip('.')}; run {command} --help"


def _fail(reason: str, status: int) -> int:
    session.error(reason)
    try:
        session.end(status, reason)
        sys.stdout.flush()
    # The object cannot be printed, but the reason was.
    except OSError:
        abandon_output()
    return status


def _check_opencv() -> None:
    """A package that pulls in another build of OpenCV overwrites ours, and pip does not notice."""
    cv2 = importlib.import_module("cv2")
    if not hasattr(cv2, "xfeatures2d"):
        raise InputError(
            f"OpenCV {cv2.__version__} lacks its contrib modules: another package replaced it; run "
            "pip install --force-reinstall --no-deps opencv-contrib-python-headless"
        )
