"""Shows the same pair through the golden model and through hardware, side by side."""

import math
from html import escape

from nicegui import ui

from skymosaic.panel.options import HARDWARE
from skymosaic.panel.pages.page_layout import show_command
from skymosaic.panel.pages.sidebar import enable_while_idle
from skymosaic.panel.results import HardwareResult, MosaicResult
from skymosaic.panel.session import Session

CLOCK_HZ = 150e6
"""The design's target on a Zynq-7020, not reached on a board yet; 1080p60 video needs 148.5 MHz."""


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
            button = ui.button("Compare with the golden model", icon="memory", on_click=self._compare)
            enable_while_idle(button.props("outline no-caps"), session)
            ui.label("The first run builds a simulation, which takes minutes; later ones take seconds.").classes("hint")
        self._container = ui.element("div")
        self.update()

    def update(self) -> None:
        """Show the latest comparison."""
        result = self._session.hardware_result
        if result is not None and result is not self._shown:
            self._shown = result
            self._container.clear()
            with self._container:
                ui.html(_markup(result), sanitize=False).classes("hardware")
                show_command(result.command)

    def _compare(self) -> None:
        self._session.compare_hardware(str(self._backend.value))


def _markup(result: HardwareResult) -> str:
    comparison = result.comparison
    if comparison.mismatch is None:
        verdict = f'<p class="badge equal">Equal, bit for bit</p><p>Compared: {escape(str(comparison.coverage))}.</p>'
    else:
        verdict = f'<p class="badge different">Not equal</p><p class="fault">{escape(str(comparison.mismatch))}</p>'
    notes = "".join(f'<p class="hint">This proves little: {escape(note)}.</p>' for note in comparison.notes)
    pixels, latency = math.prod(comparison.size), max(comparison.cycles_per_frame)
    speed, software_s = comparison.cycles_per_second, comparison.golden_seconds / comparison.coverage.frames
    rows = (
        ("time per frame", f"{1000 * software_s:.0f} ms", f"{1000 * pixels / CLOCK_HZ:.2f} ms, one pixel per clock"),
        (
            "frames per second",
            f"{1 / software_s:.0f}",
            f"{CLOCK_HZ / pixels:.0f}, each matched while the next comes in",
        ),
        ("first pixel to last feature", "", f"{latency:,} clocks, {1000 * latency / CLOCK_HZ:.2f} ms"),
        ("after the last pixel", "", f"{latency - pixels:,} clocks, {1e6 * (latency - pixels) / CLOCK_HZ:.2f} µs"),
        ("simulated", "", f"{speed / 1e6:.2f} M clocks/s, both frames in {comparison.seconds:.2f} s"),
    )
    body = "".join(
        f"<tr><th>{name}</th><td>{software}</td><td>{hardware}</td></tr>" for name, software, hardware in rows
    )
    return (
        f"{verdict}{notes}<table class='bars sides'><thead><tr><th></th><th>golden model, this machine</th>"
        f"<th>hardware at its target of 150 MHz ({escape(result.backend)})</th></tr></thead>"
        f"<tbody>{body}</tbody></table>"
    )
