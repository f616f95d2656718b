"""Signals with a layout, typed as the views that they are."""

from typing import cast

from amaranth import Signal
from amaranth.lib import data


def view_signal(
    layout: data.Layout | type[data.Struct], *, name: str | None = None, reset_less: bool = False
) -> data.View:
    """Make ``Signal(layout)``, typed as the view that it is.

    Amaranth makes the view in a metaclass, which mypy does not follow: to mypy, the call returns a plain ``Signal``
    without fields. ``name`` and ``reset_less`` are those of ``Signal``.
    """
    # One frame further up, or every signal would be named after a variable in here.
    signal = Signal(layout, src_loc_at=1, name=name, reset_less=reset_less)
    return cast(data.View, signal)
