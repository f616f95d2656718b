"""The membership curves of an input, with corners that a pointer or the arrow keys move."""

from collections.abc import Awaitable, Callable, Sequence

from nicegui import ui
from nicegui.events import GenericEventArguments

OnCorner = Callable[[int, float, float], Awaitable[None]]


class Curves(ui.element, component="curves.js"):
    """Curves and their corners.

    ``on_move`` is called with number, position and degree of a corner while it is moved; ``on_drop`` with the same when
    it has been moved. The corner stays there until `release`.
    """

    def __init__(self, on_move: OnCorner, on_drop: OnCorner) -> None:
        super().__init__()
        self.props.update(label="", high=1, curves=[], corners=[])
        self.on("move", _with_numbers(on_move))
        self.on("drop", _with_numbers(on_drop))

    def show(
        self, name: str, high: float, curves: Sequence[tuple[str, str]], corners: Sequence[tuple[float, float, str]]
    ) -> None:
        """Show an input from 0 to ``high``: curves (name, ``x,y`` in shares of the axes), corners (x, degree, name)."""
        self.props.update(label=f"Curves of {name}", high=high, curves=curves, corners=corners)

    def release(self) -> None:
        """Show all corners where the curves have them, but one that is being moved."""
        self.run_method("release")


def _with_numbers(handler: OnCorner) -> Callable[[GenericEventArguments], Awaitable[None]]:
    return lambda event: handler(int(event.args[0]), float(event.args[1]), float(event.args[2]))
