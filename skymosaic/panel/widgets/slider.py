"""A slider that moves at once in the browser and reports to the server at most 20 times per second."""

from collections.abc import Callable

from nicegui import ui

INTERVAL_S = 0.05


class Slider(ui.element, component="slider.js"):
    """Whole positions from ``lowest`` to ``highest``; ``on_move`` receives the one that the user moves to."""

    def __init__(self, on_move: Callable[[int], None]) -> None:
        super().__init__()
        self._position: int | None = None

        def moved(position: int) -> None:
            self._position = position
            on_move(position)

        self.on("move", lambda event: moved(int(event.args)), throttle=INTERVAL_S)

    def show(self, *, lowest: int, highest: int, position: int, label: str, words: str) -> None:
        """Set the range, the accessible name, the value in words and, if it differs, the thumb's position."""
        self.props.update(min=lowest, max=highest, label=label, words=words)
        # A changed prop would not move a slider that the page has already built; only the method does.
        if self._position is None:
            self.props["start"] = position
        elif position != self._position:
            self.run_method("moveTo", position)
        self._position = position
