"""The two errors that a request can end with; each has a one-line message for the user."""


class InputError(Exception):
    """An input is unusable; the message names it and says what is wrong and what to do (exit status 2)."""


class RegistrationError(Exception):
    """The images are valid but no mosaic can be made of them; the message says why, with counts (exit status 3)."""
