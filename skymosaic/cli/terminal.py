"""Keeps libraries' messages off the terminal, and removes temporary files when a signal ends the program."""

import contextlib
import io
import logging
import os
import signal
import sys
import warnings
from collections.abc import Iterator
from types import FrameType
from typing import TextIO


@contextlib.contextmanager
def without_library_messages() -> Iterator[None]:
    """Keep messages that libraries write to standard error from the terminal.

    libpng, libtiff and others print a line for each fault of a file, Pillow and NumPy warn, Dask logs; our own line
    names it. Python's ``sys.stderr`` goes on to the terminal. Does nothing where ``sys.stderr`` has been replaced.
    """
    if not _is_descriptor(sys.stderr, 2):
        yield
        return
    ours = sys.stderr
    # Libraries in C write to descriptor 2, which `contextlib.redirect_stderr` does not reach.
    terminal = os.dup(2)
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 2)
    os.close(nowhere)
    try:
        sys.stderr = os.fdopen(terminal, "w", 1, ours.encoding, "backslashreplace", closefd=False)
        # Dask logs lost connections with tracebacks.
        logging.disable(logging.CRITICAL)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    finally:
        logging.disable(logging.NOTSET)
        with contextlib.suppress(OSError):
            sys.stderr.close()
        sys.stderr = ours
        os.dup2(terminal, 2)
        os.close(terminal)


@contextlib.contextmanager
def ended_by_signals() -> Iterator[None]:
    """Turn SIGTERM into SystemExit, so that contexts remove their temporary files as after Ctrl-C.

    A closed terminal is made SIGTERM, which uvicorn handles by itself.
    """

    def end(number: int, _frame: FrameType | None) -> None:
        if number == signal.SIGTERM:
            raise SystemExit(128 + number)
        signal.raise_signal(signal.SIGTERM)

    # Windows has no SIGHUP, and nohup has it ignored.
    numbers = [getattr(signal, name) for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name)]
    before = {number: signal.signal(number, end) for number in numbers if signal.getsignal(number) != signal.SIG_IGN}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def open_outputs() -> None:
    """Escape what an output's encoding lacks; without an output, as in services, what is printed is discarded."""
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if stream is None:
            setattr(sys, name, os.fdopen(os.open(os.devnull, os.O_WRONLY), "w", encoding="utf-8"))
        elif isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")


def abandon_output() -> None:
    """Discard what standard output still holds: Python would try again at its end, and print a traceback."""
    if _is_descriptor(sys.stdout, 1):
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, 1)
        os.close(nowhere)


def _is_descriptor(stream: TextIO, number: int) -> bool:
    try:
        return stream.fileno() == number
    except (AttributeError, OSError, ValueError):
        return False
