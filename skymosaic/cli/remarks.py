"""What commands say of a mosaic beside its numbers: notes about it, and what it does not contain."""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from skymosaic.cli.session import session
from skymosaic.common.errors import RegistrationError
from skymosaic.flight.mapping.place import explain_absence
from skymosaic.flight.picture.formats import format_of
from skymosaic.flight.picture.output import Delivery
from skymosaic.reports.summary import describe_mosaic

MAX_NAMED = 3
"""Photographs that are left out for one reason and named."""

Absent = Mapping[Any, str]
"""Why frames, by their numbers, or files that could not be read, by their names, are not in the mosaic."""


def show_notes(delivery: Delivery, path: Path) -> None:
    """Print what only some mosaics have, and warn of what is wrong with one; ``path`` is its name as typed."""
    for about, line in describe_mosaic(delivery).items():
        if about in ("size", "light", "contradiction"):
            session.warn(f"{path}: {line}")
        elif about in ("warp", "blurred", "cut off", "bands", "range", "map"):
            session.show(f"{about}: {line}")
    if not delivery.georeference and format_of(delivery.path).on_map:
        session.warn(explain_absence(path, delivery.composition.place))
    # Who asks for a picture of two photographs expects no map.
    elif delivery.map_note and (delivery.georeference or delivery.flight.pair is None):
        session.tell(f"note: {delivery.map_note}")


def group_reasons(reasons: Iterable[str]) -> list[str]:
    """Join lines of the form "name: reason" that have the reason in common, the first names with how many more."""
    alike: dict[str, list[str]] = {}
    for line in reasons:
        alike.setdefault(line.partition(": ")[2] or line, []).append(line)
    joined = []
    for reason, lines in alike.items():
        first = ", ".join(line.removesuffix(f": {reason}") for line in lines[:MAX_NAMED])
        more = f" and {len(lines) - MAX_NAMED} more" if len(lines) > MAX_NAMED else ""
        joined.append(lines[0] if len(lines) == 1 else f"{first}{more}: {reason}")
    return joined


def report_absent(absent: Absent, *, strict: bool) -> None:
    """Warn of what the mosaic does not contain, by the reasons, before anything is written.

    Raises
    ------
    RegistrationError
        With ``strict``, if anything is absent.
    """
    for line in group_reasons(absent.values()):
        session.warn(f"left out: {line}")
    if strict and absent:
        raise RegistrationError(f"{len(absent)} left out, and --strict allows none; nothing was written")
