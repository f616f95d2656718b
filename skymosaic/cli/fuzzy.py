"""The command for fuzzy systems: rules as text, curves and surfaces as pictures, the integer model and its errors."""

import dataclasses
import importlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.table import Table
from rich.text import Text

from golden_model.fuzzy.fll import load_system
from golden_model.fuzzy.rules import SHIPPED
from golden_model.text import one_line
from skymosaic.cli.options import OutputVariableOption, OverwriteOption, output_option, read_file
from skymosaic.cli.outputs import Writes
from skymosaic.cli.session import STDOUT, session
from skymosaic.common.errors import InputError
from skymosaic.fuzzy.plotted_systems import PLOTTED_SYSTEMS, PlottedSystem, plan_plot
from skymosaic.fuzzy.quantised import ENTRIES, MIN_FIRING_STRENGTH, ErrorBounds, measure_errors, quantise
from skymosaic.imagery.images import check_output, check_output_folder, save_bytes

FOLDER = Path("fuzzy")


@dataclass(frozen=True)
class _Description:
    """What is shown of a system, the project's own or one from a file."""

    name: str
    rules: Table
    plotted: Callable[[], PlottedSystem]
    numbers: dict[str, Any]


def fuzzy(
    *,
    systems: Annotated[
        list[str] | None,
        typer.Argument(
            help=f"{', '.join(PLOTTED_SYSTEMS)}, or files of FLL or MATLAB (.fis); by default the project's own.",
            metavar="[SYSTEM|FILE]...",
            autocompletion=lambda: list(PLOTTED_SYSTEMS),
        ),
    ] = None,
    plot: Annotated[bool, typer.Option("--plot", help="Draw membership curves and rule surfaces.")] = False,
    output: Annotated[
        Path | None,
        output_option("Folder for the pictures of --plot; by default fuzzy."),
        Writes(r".*\.png", list_outputs=lambda output, typed: [output or FOLDER] if typed["plot"] else []),
    ] = None,
    write: Annotated[
        Path | None, typer.Option(help="Write the named built-in system to an .fll file; -: to stdout."), Writes()
    ] = None,
    entries: Annotated[
        int, typer.Option(min=2, max=1 << 16, help="Table entries of each input in the integer model of a file.")
    ] = ENTRIES,
    output_variable: OutputVariableOption = None,
    overwrite: OverwriteOption = False,
) -> None:
    """Print the rules of the fuzzy systems, or of your own in files of FLL or MATLAB (.fis), and draw them.

    For a file, print the integer model's errors against real numbers, too, as shares of the output's range.
    """
    names = systems or list(PLOTTED_SYSTEMS)
    if entries != ENTRIES and not any(Path(name).suffix for name in names):
        raise InputError("--entries is the length of the tables of a file; name one, or leave it out")
    folder = _check_plot(names, output, overwrite=overwrite) if plot else None
    if output and not plot:
        raise InputError(f"-o {output} is the folder for pictures; add --plot, or leave it out")
    if write:
        _write(names, write, overwrite=overwrite)
    shown = [
        _describe_file(Path(name), entries, output_variable) if Path(name).suffix else _describe_shipped(name)
        for name in names
    ]
    session.numbers["systems"] = [each.numbers for each in shown]
    for each in shown:
        session.show(each.rules)
        if errors := each.numbers.get("errors"):
            session.show(_describe_errors(each.name, entries, ErrorBounds(**errors)))
    if folder:
        _draw(shown, folder)


def _check_plot(names: list[str], output: Path | None, *, overwrite: bool) -> Path:
    """The folder for the pictures, in which each system needs a name of its own."""
    drawn: dict[str, str] = {}
    for name in names:
        if other := drawn.get(stem := Path(name).stem):
            raise InputError(f"{name}: its picture would replace that of {other}; draw it into another folder")
        drawn[stem] = name
    folder = output or FOLDER
    check_output_folder(folder, overwrite=overwrite)
    return folder


def _describe_shipped(name: str) -> _Description:
    if name not in PLOTTED_SYSTEMS:
        raise InputError(f"no fuzzy system {name}; valid: {', '.join(PLOTTED_SYSTEMS)}, or an .fll or .fis file")
    plotted = PLOTTED_SYSTEMS[name]
    system = plotted.system()
    rules = [[*(chosen or "any" for chosen in rule.sets), rule.output] for rule in system.rules]
    title = f"{name}: {plotted.title}, AND is the {system.conjunction}"
    table = _table(title, [axis.label for axis in plotted.axes], "weight", rules)
    return _Description(name, table, lambda: plotted, {"name": name, "conjunction": system.conjunction, "rules": rules})


def _describe_file(path: Path, entries: int, output_variable: str | None) -> _Description:
    system = read_file(load_system, path, output_variable)
    try:
        quantised = quantise(system, entries)
    except ValueError as error:
        raise InputError(f"{path}: has no integer model: {error}") from None
    inputs = [variable.name for variable in system.inputs]
    rules = [
        [*(rule.conditions.get(name, "any") for name in inputs), system.output.constants[rule.conclusion]]
        for rule in system.rules
    ]
    table = _table(f"{path}: {system.name}, AND is the {system.conjunction}", inputs, system.output.name, rules)
    numbers: dict[str, Any] = {"name": system.name, "conjunction": system.conjunction, "rules": rules}
    numbers["errors"] = dataclasses.asdict(measure_errors(quantised))
    numbers["tables"] = {
        variable.name: {name: table.tolist() for name, table in variable.sets.items()}
        for variable in quantised.model.inputs
    }
    return _Description(path.stem, table, lambda: plan_plot(quantised), numbers)


def _describe_errors(name: str, entries: int, errors: ErrorBounds) -> str:
    compared = "all" if errors.complete else "random"
    return (
        f"{name}: integer model with {entries} entries per input: largest error {errors.largest:.4f} "
        f"({errors.firm:.4f} where the strengths sum to {MIN_FIRING_STRENGTH:g} or more), mean {errors.mean:.4f}, "
        f"at {compared} {errors.checked} inputs; up to {errors.step:.4f} more between two entries; "
        f"silent at {errors.silent:.2%}"
    )


def _table(title: str, inputs: list[str], output: str, rules: list[list[Any]]) -> Table:
    table = Table(title=Text(one_line(title)), title_justify="left")
    for heading in ("rule", *inputs, output):
        table.add_column(Text(one_line(heading)), justify="right" if heading in ("rule", output) else "left")
    for index, (*sets, value) in enumerate(rules):
        table.add_row(str(index), *(Text(one_line(each)) for each in sets), f"{value:g}")
    return table


def _write(names: list[str], path: Path, *, overwrite: bool) -> None:
    """Write one of the systems that are shipped as FLL, to start with."""
    if len(names) != 1:
        raise InputError(f"--write takes one system, not {len(names)}; name it")
    shipped = {path.stem: path for path in sorted(SHIPPED.glob("*.fll"))}
    if names[0] not in shipped:
        raise InputError(f"{names[0]} is not shipped as FLL; valid: {', '.join(shipped)}")
    with session.destination(path, "system.fll") as target:
        if path != STDOUT:
            check_output(target, suffixes=(".fll",), overwrite=overwrite)
        save_bytes(target, shipped[names[0]].read_bytes())
    session.wrote(path)
    session.show(f"wrote {path}")


def _draw(systems: list[_Description], folder: Path) -> None:
    # Matplotlib is an extra, and takes a second to import.
    draw_system = importlib.import_module("skymosaic.fuzzy.plots").draw_system
    folder.mkdir(parents=True, exist_ok=True)
    for each in systems:
        path = folder / f"{each.name}.png"
        try:
            save_bytes(path, draw_system(each.plotted()))
        except ValueError as error:
            raise InputError(f"{each.name}: {error}") from None
        session.wrote(path)
        session.show(f"picture {path}")
