"""The membership curves of an input, with corners that a pointer or the arrow keys move."""

from collections.abc import Awaitable, Callable, Sequence

from nicegui import ui

INTERVAL_S = 0.1


class Curves(ui.element, component="curves.js"):
    """Curves and their corners.

    Parameters
    ----------
    on_move : callable
        Called with number, position and degree of a corner while it is moved.
    on_drop : callable
        Called when it has been moved.
    """

    def __init__(self, on_move: Callable[[int, float, float], Awaitable[None]], on_drop: Callable[[], None]) -> None:
        super().__init__()
        self.props.update(label="", high=1, curves=[], corners=[])
        self.on(
            "move",
            lambda event: on_move(int(event.args[0]), float(event.args[1]), float(event.args[2])),
            throttle=INTERVAL_S,
        )
        self.on("drop", on_drop)

    def show(
        self, name: str, high: float, curves: Sequence[tuple[str, str]], corners: Sequence[tuple[float, float, str]]
    ) -> None:
        """Show an input from 0 to ``high``: curves (name, ``x,y`` in shares of the axes), corners (x, degree, name)."""
        self.props.update(label=f"Curves of {name}", high=high, curves=curves, corners=corners)
