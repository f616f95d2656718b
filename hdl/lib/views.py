"""Signals with a layout, under the type that they have."""

from __future__ import annotations

from typing import Any, cast

from amaranth import Signal
from amaranth.lib import data


def view_signal(
    layout: data.Layout | type[data.Struct], *, name: str | None = None, init: Any = None, reset_less: bool = False
) -> data.View:
    """``Signal(layout)``, declared as the view that it is.

    Amaranth makes the view in a metaclass, which mypy does not follow: it takes the call for a plain ``Signal`` and
    rejects every field.

    Parameters
    ----------
    layout : Layout or subclass of Struct
    name : str or None
        None: the name of the variable that the signal is assigned to, as with ``Signal``.
    init : mapping, sequence or None
        Values after reset, by field; None: zero, or the layout's own.
    reset_less : bool
        Reset does not change the signal.
    """
    # One frame further up, or every signal would be named after a variable in here.
    signal = Signal(layout, src_loc_at=1, name=name, init=init, reset_less=reset_less)
    return cast(data.View, signal)
