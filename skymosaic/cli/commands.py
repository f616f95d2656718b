"""The commands by name, each of which is imported when it is called."""

import importlib
from collections.abc import Callable
from typing import Annotated, Any

import typer
from typer.core import TyperGroup
from typer.main import get_command

from skymosaic.cli import print_version
from skymosaic.cli.completion import sketch
from skymosaic.common.errors import InputError

QuietOption = Annotated[bool, typer.Option("-q", "--quiet", help="Print results, warnings and errors only.")]
VerboseOption = Annotated[
    bool, typer.Option("-v", "--verbose", help="Print progress as lines, details, and what libraries report.")
]
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
    # A package that pulls in another build of OpenCV overwrites ours, and pip does not notice. Here, before the
    # command's module, which would fail with a traceback.
    cv2 = importlib.import_module("cv2")
    if not hasattr(cv2, "xfeatures2d"):
        raise InputError(
            f"OpenCV {cv2.__version__} lacks its contrib modules: another package replaced it; run "
            "pip install --force-reinstall --no-deps opencv-contrib-python-headless"
        )
    made = typer.Typer(add_completion=False, pretty_exceptions_enable=False, help=COMMANDS[name])
    functions = import_functions(name, before)
    for words, function in functions.items():
        made.command(words.split()[-1])(function)
    if name not in functions:
        made.callback(invoke_without_command=True)(_require_command)
    return get_command(made)


def import_functions(name: str, before: dict[str, bool]) -> dict[str, Callable[..., None]]:
    """The function of a command, or of each command of a group, with all its options, by the words that call it."""
    command = getattr(importlib.import_module(f"skymosaic.cli.{name}"), name)
    own = (
        {f"{name} {each}": function for each, function in command.items()}
        if isinstance(command, dict)
        else {name: command}
    )
    complete_command = importlib.import_module("skymosaic.cli.options").complete_command
    return {words: complete_command(words, function, before) for words, function in own.items()}


def _require_command(context: typer.Context) -> None:
    if context.invoked_subcommand is None:
        group: Any = context.command
        valid = ", ".join(group.commands)
        raise InputError(f"{context.info_name} needs one of {valid}; run {context.command_path} --help")


def _replaced() -> None:
    raise AssertionError("a placeholder: the command itself is imported before it is called")


def _print_version(asked: bool) -> None:
    if asked:
        raise typer.Exit(print_version())


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


def run() -> int | None:
    """Run the command that was typed; its exit status.

    Raises
    ------
    InputError
        For an unusable command line.
    """
    try:
        # Standalone, Click would print its errors in several lines and end the process.
        status: int | None = app(prog_name="skymosaic", standalone_mode=False)
    except typer.TyperException as error:
        raise InputError(_describe_usage(error)) from None
    return status


def _describe_usage(error: typer.TyperException) -> str:
    """What is wrong with the command line, and which help explains it."""
    context = getattr(error, "ctx", None)
    command = context.command_path if context else "skymosaic"
    return f"{' '.join(error.format_message().split()).rstrip('.')}; run {command} --help"
