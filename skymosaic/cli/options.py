"""Turns the library's options into options of a command, and what the user typed into an object of options."""

import dataclasses
import functools
import importlib
import inspect
import math
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from types import ModuleType
from typing import Annotated, Any, TypeVar, get_args, get_type_hints

import typer
from rich.table import Table
from rich.text import Text

from golden_model.config import RULE_BASES
from golden_model.config_file import load_config
from golden_model.fuzzy.rules import MatchRules, load_rules
from golden_model.text import how_to_install, one_line
from skymosaic.cli.session import session
from skymosaic.common.errors import InputError
from skymosaic.common.options import GROUPS, INPUT, MACHINE, MAP, OUTPUT, Option, options_of
from skymosaic.imagery.lens import load_lens
from skymosaic.maps.control_points import load_control_points
from skymosaic.maps.positions import load_positions
from skymosaic.registration.options import FeatureOptions
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


OverwriteOption = Annotated[
    bool,
    typer.Option("--overwrite", rich_help_panel=OUTPUT, help="Replace files that exist; without it they are refused."),
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
    typer.Option("--require-map", rich_help_panel=MAP, help="Exit with 3 where the mosaic has no place on the map."),
]
PhotographsArgument = Annotated[
    list[str],
    typer.Argument(help="Overlapping photographs, folders of them, or a video.", metavar="PHOTOGRAPHS|FOLDER|VIDEO"),
]
# One option of the library, typed in two parts.
AddressOption = Annotated[
    str | None, typer.Option(metavar="HOST[:PORT]", rich_help_panel=MACHINE, help="The board, for --backend board.")
]
CameraOption = Annotated[
    Path | None, typer.Option(rich_help_panel=INPUT, help="TOML file with intrinsics and distortion.")
]
MaskOption = Annotated[
    Path | None, typer.Option(rich_help_panel=INPUT, help="Picture, black where photographs show no ground.")
]


def with_options(command: Callable[..., None]) -> Callable[..., None]:
    """Give a command an option for each field of its parameter ``options``, an object of the library.

    The parameter's annotation names the class and, with ``Annotated``, those of its options that the command has, and
    the choices of those that have fewer there. A default of the parameter holds other defaults than the class.
    """
    signature = inspect.signature(command, eval_str=True)
    declared = signature.parameters["options"]
    cls, names, *fewer = get_args(declared.annotation) or (declared.annotation, None)
    choices: dict[str, tuple[str, ...]] = fewer[0] if fewer else {}
    usual = cls() if declared.default is inspect.Parameter.empty else declared.default
    options = [
        dataclasses.replace(each, choices=choices.get(each.name, each.choices))
        for each in options_of(cls)
        if names is None or each.name in names
    ]
    typed = {name: parameter for each in options for name, parameter in _parameters(each, usual)}

    @functools.wraps(command)
    def run(**values: Any) -> None:
        # Tests call a command as a function, without the options that keep their defaults.
        chosen = {name: values.pop(name, each.default) for name, each in typed.items()}
        command(options=_read(usual, chosen), **values)

    others = [each for each in signature.parameters.values() if each is not declared]
    parameters = sorted([*others, *typed.values()], key=_group_number)
    # Typer reads options from the signature.
    vars(run)["__signature__"] = signature.replace(parameters=parameters)
    return run


def _group_number(parameter: inspect.Parameter) -> int:
    """The place of a parameter's group in the help; arguments and options without a group come first."""
    group = get_args(parameter.annotation)[1].rich_help_panel
    return GROUPS.index(group) if group else -1


def _parameters(option: Option, usual: FeatureOptions) -> Iterator[tuple[str, inspect.Parameter]]:
    """What the user types for one option."""
    annotations: dict[str, Any] = {"camera": CameraOption, "mask": MaskOption}
    if option.name != "lens":
        of_type = {
            "backend": str,
            "config": Path | None,
            "rules": str | None,
            "control": Path | None,
            "positions": Path | None,
        }.get(option.name)
        of_type = of_type or get_type_hints(type(usual))[option.name]
        annotations = {option.name: Annotated[of_type, _typer_option(option)]}
    if option.name == "backend":
        annotations["address"] = AddressOption
    for name, annotation in annotations.items():
        default: Any = getattr(usual, name, None)
        typed = default // option.flag_unit if option.flag_unit > 1 and default is not None else default
        yield name, inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=typed, annotation=annotation)


def _typer_option(option: Option) -> Any:
    if option.choices:
        return choice(option.choices, option.help, option.flag, group=option.group)
    minimum = None if option.minimum is None else math.ceil(option.minimum / option.flag_unit)
    return typer.Option(
        option.flag,
        help=option.help,
        metavar=option.flag_unit_name.upper() or None,
        min=minimum,
        max=option.maximum,
        rich_help_panel=option.group,
    )


def _read(usual: FeatureOptions, typed: dict[str, Any]) -> FeatureOptions:
    """The options that the user typed, with the contents of the files that they name.

    Raises
    ------
    InputError
        For an unusable file, an unknown name, an impossible value or combination.
    """
    units = {each.name: each.flag_unit for each in options_of(type(usual))}
    values = {
        name: value * units[name] if units.get(name, 1) > 1 and value is not None else value
        for name, value in typed.items()
    }
    camera, mask, address = (values.pop(name, None) for name in ("camera", "mask", "address"))
    if camera or mask:
        values["lens"] = load_lens(camera, mask)
    if address:
        if values["backend"] != "board":
            raise InputError(f"--address {address} is for a board; add --backend board, or leave it out")
        values["backend"] = f"board:{address}"
    if values.get("config"):
        values["config"] = read_file(lambda path: load_config(path, values["preset"]), values["config"])
    if values.get("rules"):
        values["rules"] = read_rules(values["rules"])
    if values.get("control"):
        values["control"] = load_control_points(values["control"])
    if values.get("positions"):
        values["positions"] = load_positions(values["positions"])
    options = dataclasses.replace(usual, **values)
    for each in options_of(type(usual)):
        each.check(getattr(options, each.name), called=each.flag)
    options.check()
    return options


def read_rules(given: str) -> str | MatchRules:
    """The rules in an ``.fll`` file; a name stays as it is.

    Raises
    ------
    InputError
        For a file that holds no rules for matches, or an unknown name.
    """
    if Path(given).suffix:
        return read_file(load_rules, Path(given))
    if given not in RULE_BASES:
        raise InputError(f"--rules is {given!r}; valid: {', '.join(RULE_BASES)}, or an .fll file")
    return given


def read_file(read: Callable[[Path], Content], path: Path) -> Content:
    """What ``read`` makes of a file; its ``ValueError``, a line for the user, becomes an `InputError`."""
    try:
        return read(path)
    except ValueError as error:
        raise InputError(str(error)) from None


def import_plots(name: str) -> ModuleType:
    """Import a module that needs matplotlib, which is an extra and takes a second to import.

    Raises
    ------
    InputError
        If matplotlib is not installed.
    """
    try:
        return importlib.import_module(name)
    except ImportError:
        raise InputError(f"pictures need matplotlib; {how_to_install('plots')}") from None


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
