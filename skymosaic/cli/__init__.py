"""The command line. docs/how-to/command_line.md says what all commands have in common, and what exit statuses mean."""

import contextlib
import importlib
import sys

from golden_model.version import VERSION
from sim.backends.errors import BackendError
from skymosaic.cli.terminal import abandon_output, ended_by_signals, open_outputs, without_library_messages
from skymosaic.common.errors import InputError, RegistrationError

PIPE_CLOSED = 128 + 13
"""Exit status where the reader of standard output has gone: as of a program that SIGPIPE ends."""

INTERRUPTED = 128 + 2
"""Exit status after Ctrl-C."""


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
            if sys.argv[1:] == ["--version"]:
                return print_version()
            # As a path it would be the current folder.
            if "" in sys.argv[1:]:
                raise InputError("an argument is empty; leave it out, or give the variable it comes from a value")
            # The commands import Typer, which takes three times as long as the answer without it.
            status: int | None = importlib.import_module("skymosaic.cli.commands").run()
        finally:
            # Now rather than at Python's end, where a full disk would be a traceback.
            sys.stdout.flush()
    except (SystemExit, BrokenPipeError, KeyboardInterrupt) as end:
        return _status_of(end)
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


def print_version() -> int:
    """Print the program's name and version; the exit status."""
    print(f"skymosaic {VERSION}")
    return 0


def _status_of(end: SystemExit | BrokenPipeError | KeyboardInterrupt) -> int | str | None:
    # Where modules are still imported; later Click makes it this status.
    if isinstance(end, KeyboardInterrupt):
        return INTERRUPTED
    # Click makes a closed pipe a silent 1, which is the status of `compare` for a difference.
    if isinstance(end, SystemExit) and not isinstance(end.__context__, BrokenPipeError):
        return end.code
    abandon_output()
    return PIPE_CLOSED


def _fail(reason: str, status: int) -> int:
    # It imports Rich, which takes longer than all that `skymosaic --version` does.
    session = importlib.import_module("skymosaic.cli.session").session
    session.error(reason)
    try:
        session.end(status, reason)
        sys.stdout.flush()
    # The object cannot be printed, but the reason was.
    except OSError:
        abandon_output()
    return status
