"""One rule for all commands, by what their parameters declare: no output is an input, and no two are the same."""

import contextlib
import importlib
import inspect
import itertools
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple, TypeVar, get_args

from golden_model.temporary import hold, lock_for
from skymosaic.cli.session import STDOUT
from skymosaic.common.errors import InputError
from skymosaic.common.options import flag_of
from skymosaic.common.replaced import find_replaced, refuse_inputs
from skymosaic.common.temporary import existing_parent, resolved

Typed = Mapping[str, Any]
Mark = TypeVar("Mark")


@dataclass(frozen=True)
class Writes:
    """Marks a parameter that names an output; stands behind what Typer reads."""

    own: str = ""
    """Regular expression of the names that the command replaces in a folder; empty for a file."""
    list_outputs: Callable[[Any, Typed], Iterable[Path]] = lambda path, _typed: () if path is None else (path,)
    """Lists the outputs, of what is typed here, None if nothing, and of all that is typed."""


@dataclass(frozen=True)
class Reads:
    """Marks a parameter that may name a folder; ``list_files`` lists what is read of it, and raises InputError."""

    list_files: Callable[[Path], Iterable[Path]]


class _Output(NamedTuple):
    path: Path
    flag: str
    own: str


def check_typed_outputs(command: inspect.Signature, typed: Typed) -> list[Path]:
    """List the outputs; refuse one that would replace an input, or another output, under whatever name.

    Inputs are all files that are typed where no output is, and those of folders; without a file, nothing is lost.

    Raises
    ------
    InputError
    """
    inputs: list[Path] = []
    outputs: list[_Output] = []
    for name, parameter in command.parameters.items():
        value = typed[name]
        if writes := _mark(parameter, Writes):
            paths = writes.list_outputs(value, typed)
            outputs += [_Output(path, flag_of(name), writes.own) for path in paths if path != STDOUT]
        else:
            for each in value if isinstance(value, list) else [value]:
                inputs += _list_files(each, _mark(parameter, Reads))
    for output in outputs:
        refuse_inputs(output.path, inputs, output.own)
    for output, other in itertools.permutations(outputs, 2):
        _refuse_clash(output, other)
    return [output.path for output in outputs]


@contextlib.contextmanager
def claimed(outputs: Iterable[Path]) -> Iterator[None]:
    """Context in which no other run writes these outputs, where the file system has locks.

    Raises
    ------
    InputError
        If another run writes one of them.
    """
    with contextlib.ExitStack() as claims:
        for path in outputs:
            place = resolved(path)
            try:
                # Whoever tidies up holds it for a moment.
                claims.enter_context(hold(lock_for(place, existing_parent(place)), timeout_s=0.2))
            except TimeoutError:
                reason = "is being written by another run; wait for its end, or choose another name"
                raise InputError(f"{path}: {reason}") from None
            # The place cannot be written, of which the command will say more.
            except OSError:
                continue
        yield


def _mark(parameter: inspect.Parameter, kind: type[Mark]) -> Mark | None:
    return next((mark for mark in get_args(parameter.annotation) if isinstance(mark, kind)), None)


def _list_files(value: object, reads: Reads | None) -> Iterable[Path]:
    """The files of one typed value, which may be a file, a pattern, a folder, an address or a number."""
    # NumPy is not imported before a command runs, because completion would wait for it.
    list_matches = importlib.import_module("skymosaic.imagery.folders").list_matches
    files: list[Path] = []
    # Whoever reads it says what is wrong.
    with contextlib.suppress(InputError, OSError, ValueError):
        for path in list_matches(Path(value)) if isinstance(value, str | Path) else ():
            if path.is_file():
                files.append(path)
            elif reads and path.is_dir():
                files += reads.list_files(path)
    return files


def _refuse_clash(output: _Output, other: _Output) -> None:
    if output.own and resolved(output.path) == resolved(other.path):
        raise InputError(f"{output.path}: is both {output.flag} and {other.flag}; name two folders")
    if find_replaced(output.path, [other.path], output.own):
        if output.own:
            by = f"would be replaced by a file of {output.flag} {output.path}"
            raise InputError(f"{other.path}: {by}; choose another name or folder")
        raise InputError(f"{output.path}: is both {output.flag} and {other.flag}; name two files")
