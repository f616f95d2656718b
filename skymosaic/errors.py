"""The two ways a request can fail; each carries one line for the user."""


class InputError(Exception):
    """Something the user gave is unusable: the line names it, what is wrong and what to do (exit status 2)."""


class RegistrationError(Exception):
    """The images are fine but no mosaic can be made of them: the line says why, with counts (exit status 3)."""
