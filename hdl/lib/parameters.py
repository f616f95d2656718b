"""Checks of the parameters of blocks: what a block cannot be built for is refused where it is made."""

from collections.abc import Sequence


def check_choice(name: str, value: int, valid: Sequence[int]) -> None:
    """Compare a parameter with the values that a block is made for.

    Raises
    ------
    ValueError
        For another value, naming the valid ones.
    """
    if value not in valid:
        raise ValueError(f"{name} is {value}; valid: {', '.join(map(str, valid))}")


def check_range(name: str, value: int, least: int, most: int | None = None) -> None:
    """Compare a parameter with the smallest and the largest value that a block is made for.

    Raises
    ------
    ValueError
        Outside them.
    """
    if value < least or (most is not None and value > most):
        allowed = f"at least {least}" if most is None else f"{least} to {most}"
        raise ValueError(f"{name} is {value}; it must be {allowed}")
