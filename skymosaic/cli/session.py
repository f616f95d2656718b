"""Prints for a command: results on standard output; progress, notes, warnings and errors on standard error.

With ``--json`` the results are one object instead; docs/how-to/command_line.md describes its keys.
"""

import contextlib
import json
import platform
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

from rich.console import Console, RenderableType
from rich.text import Text

from golden_model.temporary import temporary_folder
from golden_model.text import one_line
from golden_model.version import VERSION
from skymosaic.common.errors import InputError
from skymosaic.common.options import respell
from skymosaic.common.provenance import finite, provenance

STDOUT = Path("-")
"""The output of this name is standard output."""
PIPED_WIDTH = 1000
"""Columns of a table that is not read on a terminal, where nothing should be wrapped."""


class Terminal(Console):
    """Without Rich's answer to a closed pipe, which ends the program with 1 and discards standard output."""

    def on_broken_pipe(self) -> None:
        """Leave it to whoever prints: a closed standard error must not cost the user the mosaic."""
        raise BrokenPipeError

    def print_line(self, line: str, style: str = "") -> None:
        """Print a message on one line; options that it names become flags."""
        # A closed standard error must not cost the user the mosaic.
        with contextlib.suppress(OSError):
            self.print(one_line(respell(line)), style=style, markup=False, highlight=False, soft_wrap=True)

    def show(self, result: RenderableType) -> None:
        """Print a line of text or a table."""
        console = self if self.is_terminal else Terminal(stderr=self.stderr, width=PIPED_WIDTH)
        # Names of files are not Rich's markup, and stay on one line.
        text = Text(one_line(result)) if isinstance(result, str) else result
        console.print(text, highlight=False, soft_wrap=isinstance(result, str))
        # Where both go to one file, results and progress stay in order.
        console.file.flush()


class Session:
    """One command's conversation with its user."""

    def __init__(self) -> None:
        self.begin("", started_s=time.perf_counter(), quiet=False, verbose=False, as_json=False)

    def begin(self, command: str, *, started_s: float, quiet: bool, verbose: bool, as_json: bool) -> None:
        """Start anew for one command; ``started_s`` is when the program started, by ``time.perf_counter``."""
        self._errors = Terminal(stderr=True)
        self._command = command
        self._quiet = quiet
        self._verbose = verbose
        self._as_json = as_json
        self._started_s = started_s
        self._begun_s = time.perf_counter()
        self._ended = False
        self._stdout_taken = False
        self._warnings: list[str] = []
        self._notes: list[str] = []
        self._outputs: list[str] = []
        self.numbers: dict[str, Any] = {}
        """The command's own keys of the JSON object."""
        self.seconds: dict[str, float] = {}
        """Wall time of the command's stages; `end` adds what they leave over."""
        self.status = 0
        """Exit status of a command that ends without an error."""
        if verbose:
            self._errors.print_line(f"skymosaic {VERSION}, Python {platform.python_version()}, {platform.platform()}")

    @property
    def animated(self) -> bool:
        """Whether progress is drawn in place; otherwise it is printed as lines, unless the command is to be quiet."""
        return self._errors.is_terminal and not self._quiet and not self._verbose

    def tell(self, line: str) -> None:
        """Print a note or a line of progress, unless the command is to be quiet; options it names become flags."""
        if not self._quiet:
            self._errors.print_line(line)

    def note(self, line: str) -> None:
        """As `tell`, and put the line into the JSON object."""
        self._notes.append(one_line(respell(line)))
        self.tell(line)

    def warn(self, line: str) -> None:
        """Print a warning, and put it into the JSON object."""
        self._warnings.append(one_line(respell(line)))
        self._errors.print_line(f"warning: {line}", "yellow")

    def error(self, reason: str) -> None:
        """Print why the command failed."""
        self._errors.print_line(f"error: {reason}", "red")

    def show(self, result: RenderableType) -> None:
        """Print a line of text or a table of the result; on standard error if standard output is a file's bytes."""
        if not self._as_json:
            (self._errors if self._stdout_taken else Terminal()).show(result)

    def stream(self, numbers: Mapping[str, Any]) -> None:
        """With ``--json``, print an object on a line of its own, ahead of the command's object at the end."""
        # A reader that has gone must not cost the user the mosaic.
        with contextlib.suppress(OSError):
            if self._as_json:
                print(json.dumps(finite(numbers)), flush=True)

    def wrote(self, path: Path) -> None:
        """Record a file or folder among the outputs."""
        self._outputs.append(str(path))

    @contextlib.contextmanager
    def working(self, stage: str) -> Iterator[Callable[[str], None]]:
        """Context of a stage without a number of steps; the callable that it yields prints what is being done."""
        if not self.animated:
            self.tell(stage)
            yield self.tell
            return
        with self._errors.status(Text(stage)) as status:
            yield lambda line: status.update(Text(f"{stage}: {one_line(line)}"))

    @contextlib.contextmanager
    def destination(self, output: Path, name: str) -> Iterator[Path]:
        """Context of the path to write: ``output``, or for ``-`` a file ``name`` whose bytes go to stdout afterwards.

        Raises
        ------
        InputError
            For ``-`` with ``--json``, which needs standard output for itself.
        """
        if output != STDOUT:
            yield output
            return
        if self._as_json:
            raise InputError("-o - and --json both write to standard output; leave out one of them")
        self._stdout_taken = True
        with temporary_folder() as folder:
            yield folder / name
            sys.stdout.buffer.write((folder / name).read_bytes())
            sys.stdout.buffer.flush()

    def end(self, status: int, error: str | None = None) -> None:
        """Print the times, and with ``--json`` the object; does nothing the second time."""
        if self._ended or not self._command:
            return
        self._ended = True
        # The stages, what they leave over, and their sum: the wall time since the program began.
        total = time.perf_counter() - self._started_s
        times = {"starting": self._begun_s - self._started_s, **self.seconds}
        times |= {"other": total - sum(times.values()), "total": total}
        # Commands without stages, and failed ones, have no times worth reading.
        if self.seconds and error is None:
            shown = ", ".join(f"{stage} {value:.2f}" for stage, value in times.items())
            self.tell(f"seconds: {shown}")
        if self._as_json:
            common = {
                "command": self._command,
                **provenance(),
                "status": status,
                "error": None if error is None else one_line(respell(error)),
                "warnings": self._warnings,
                "outputs": self._outputs,
                "notes": [*self._notes, *self.numbers.pop("notes", [])],
            }
            times["processor"] = time.process_time()
            numbers = {**common, **self.numbers, "seconds": {name: round(value, 4) for name, value in times.items()}}
            print(json.dumps(finite(numbers)))


# A process runs one command.
session = Session()
