"""The error of a backend, apart from the interface: the command line, which starts without NumPy, names it."""


class BackendError(Exception):
    """A backend cannot do what was asked; one line says what is wrong, and what to do about it."""
