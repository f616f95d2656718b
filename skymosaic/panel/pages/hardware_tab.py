"""Shows the same pair through the golden model and through hardware, side by side."""

import math

from nicegui import ui

from skymosaic.evaluation.hardware import Comparison
from skymosaic.mosaicking.live.pace import CLOCK_HZ
from skymosaic.panel.options import HARDWARE
from skymosaic.panel.pages.page_layout import fill_in, show_command
from skymosaic.panel.pages.sidebar import enable_while_idle
from skymosaic.panel.results import HardwareResult, MosaicResult
from skymosaic.panel.session import Session


class HardwareTab:
    """The button that starts the comparison, and its result."""

    def __init__(self, session: Session, result: MosaicResult) -> None:
        self._session = session
        self._shown: HardwareResult | None = None
        if not result.pair.method.on_accelerator:
            ui.label(
                "This method runs on the host. The accelerator computes Harris or FAST corners with ILBP descriptors: "
                "choose these and make the mosaic again."
            ).classes("hint empty")
            return
        with ui.element("div").classes("bar"):
            names = [*HARDWARE, *session.boards]
            self._backend = ui.select(names, label="Hardware", value=names[0])
            self._backend.props("outlined dense options-dense").classes("backend")
            button = ui.button("Compare with the golden model", icon="memory")
            button.on_click(lambda: session.compare_hardware(str(self._backend.value)))
            enable_while_idle(button.props("outline no-caps"), session)
            ui.label("The first run builds a simulation, which takes minutes; later ones take seconds.").classes("hint")
        self._container = ui.element("div")

    def update(self) -> None:
        """Show the latest comparison."""
        result = self._session.hardware_result
        if result is not None and result is not self._shown:
            self._shown = result
            self._container.clear()
            with self._container:
                times = _list_times(result.comparison)
                markup = fill_in("hardware.html", times=times, **result._asdict())
                ui.html(markup, sanitize=False).classes("hardware")
                show_command(result.command)


def _list_times(comparison: Comparison) -> list[tuple[str, str, str]]:
    """Rows of the table: what is measured, in software, and in hardware."""
    pixels, latency = math.prod(comparison.size), max(comparison.cycles_per_frame)
    software_s, late = comparison.golden_seconds / comparison.coverage.frames, latency - pixels
    return [
        ("time per frame", f"{1000 * software_s:.0f} ms", f"{1000 * pixels / CLOCK_HZ:.2f} ms, one pixel per clock"),
        (
            "frames per second",
            f"{1 / software_s:.0f}",
            f"{CLOCK_HZ / pixels:.0f}, each matched while the next comes in",
        ),
        ("first pixel to last feature", "", f"{latency:,} clocks, {1000 * latency / CLOCK_HZ:.2f} ms"),
        ("after the last pixel", "", f"{late:,} clocks, {1e6 * late / CLOCK_HZ:.2f} µs"),
        (
            "simulated",
            "",
            f"{comparison.cycles_per_second / 1e6:.2f} M clocks/s, both frames in {comparison.seconds:.2f} s",
        ),
    ]
