"""Errors that end a request; each has a one-line message for the user."""

import contextlib
from collections.abc import Iterator

from golden_model.text import one_line


class _OneLineError(Exception):
    """An error with a message of one printable line, even for file names that contain line breaks."""

    def __init__(self, message: str) -> None:
        super().__init__(one_line(message))


class InputError(_OneLineError):
    """An input is unusable; the message names it and says what is wrong and what to do (exit status 2)."""


class OutputError(InputError):
    """An output cannot be written: no permission, a full disk."""


class AppearedError(OutputError):
    """An output would replace a file that was not there when the run began."""


class DamagedError(InputError):
    """A photograph's file is damaged in a part of its picture, but can be decoded."""


class RegistrationError(_OneLineError):
    """The images are valid but no mosaic can be made of them; the message says why, with counts (exit status 3)."""


@contextlib.contextmanager
def reading(path: object, advice: str) -> Iterator[None]:
    """Context in which a file or folder is read; where that is not possible, the line ends in ``advice``."""
    try:
        yield
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error}); {advice}") from None


@contextlib.contextmanager
def noting(failures: list[str]) -> Iterator[None]:
    """Context of one output of several: where it cannot be written, ``failures`` gets the line, and others follow."""
    try:
        yield
    except InputError as error:
        failures.append(str(error))
    except OSError as error:
        failures.append(f"{error.filename}: cannot be written ({error.strerror}); check the disk")
