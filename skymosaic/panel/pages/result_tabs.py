"""The tabs that show a result: the mosaic, the run in numbers, and the pair that is shown in hardware."""

import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from nicegui import ui

from golden_model.arrays import Matrix
from skymosaic.evaluation.hardware import Comparison
from skymosaic.evaluation.metrics import confusion
from skymosaic.mosaicking.live.pace import CLOCK_HZ
from skymosaic.panel.explain import classify_matches, measure_residuals
from skymosaic.panel.options import HARDWARE
from skymosaic.panel.pages import drawings
from skymosaic.panel.pages.page_layout import fill_in, show_command, show_files
from skymosaic.panel.pages.sidebar import enable_while_idle
from skymosaic.panel.results import HardwareResult, MosaicResult, ShownMosaic, picture_address
from skymosaic.panel.session import Session
from skymosaic.panel.widgets import Viewer
from skymosaic.registration.pair import Pair

CORRECT_PX = 3.0
"""A match this close to the homography counts as correct in recall and precision."""


def build_mosaic_tab(result: MosaicResult, thumbnails: Mapping[str, Path]) -> None:
    """Show a run's mosaic, or why there is none; photographs left out with their thumbnails, by name."""
    if result.mosaic is None:
        with ui.element("div").classes("empty"):
            ui.html("No mosaic could be made", tag="h2", sanitize=False)
            ui.label(result.reason).classes("fault")
            ui.label("The Matches tab shows the matches and why they were rejected.").classes("hint")
        return
    layers = {"Outlines": drawings.draw_outlines(result.mosaic.outlines.values())}
    if result.mosaic.seams:
        layers["Seams"] = drawings.draw_seams(result.mosaic.seams)
    if result.links:
        layers["Links"] = drawings.draw_links(result.mosaic.outlines, result.links)
    _show_mosaic(result.mosaic, layers)
    show_files("/file/mosaic", result.folder)
    if result.left_out:
        with ui.element("ul").classes("photographs").props('aria-label="Photographs left out"'):
            for name, reason in result.left_out.items():
                with ui.element("li"):
                    if name in thumbnails:
                        picture = ui.element("img").props('alt="" loading="lazy"')
                        picture.props["src"] = picture_address(thumbnails[name])
                    ui.label(f"left out: {reason}").classes("fault")


def _show_mosaic(mosaic: ShownMosaic, layers: Mapping[str, str]) -> None:
    """Show the mosaic, with a switch for each layer that can be drawn over it."""

    def draw() -> None:
        viewer.draw("".join(layer for name, layer in layers.items() if switches[name].value))

    with ui.element("div").classes("bar"):
        ui.label(f"{mosaic.size[0]} x {mosaic.size[1]} px, {len(mosaic.outlines)} photographs").classes("name")
        ui.label("Wheel or + and - zoom, drag moves.").classes("hint")
        ui.element("div").classes("grow")
        switches = {name: ui.switch(name, on_change=draw).props("dense") for name in layers}
    viewer = Viewer("Mosaic", [mosaic.picture], tiles=mosaic.tiles)


def build_numbers_tab(result: MosaicResult) -> None:
    """Show the numbers of a run and of the pair that is shown."""
    pair = result.pair
    left, right = map(len, pair.features)
    markup = fill_in(
        "numbers.html",
        counts={
            "corners, left": left,
            "corners, right": right,
            "mutual matches": len(pair.matches),
            "kept by the rules": len(pair.kept),
            "inliers at 2 px": len(pair.inliers),
        },
        pair=pair,
        homography="" if pair.homography is None else _describe_homography(pair.homography),
        quality=_list_quality(pair),
        correct_px=CORRECT_PX,
        seconds=result.seconds,
        facts=result.facts,
    )
    ui.html(markup, sanitize=False).classes("numbers")
    with ui.element("section").classes("card"):
        show_command(result.command)


def _describe_homography(homography: Matrix) -> str:
    """Rotation, scale and shift of the homography at the image's first pixel, in words."""
    (a, b, x), (c, d, y), _ = homography
    scale = math.sqrt(abs(a * d - b * c))
    rotation = math.degrees(math.atan2(c - b, a + d))
    return f"projective, 8 parameters: rotates by {rotation:.2f}°, scales by {scale:.4f}, shifts by {x:.1f}, {y:.1f} px"


def _list_quality(pair: Pair) -> dict[str, str]:
    """Errors of the pair, and what computed it; empty without a homography."""
    residual_px = measure_residuals(pair)
    if residual_px is None:
        return {}
    inlier = [verdict == "inlier" for verdict in classify_matches(pair)]
    counts = confusion(pair.matches["verdict"] == 1, residual_px <= CORRECT_PX)
    rows = {
        "RMSE of the inliers": f"{math.sqrt(float(np.mean(residual_px[inlier] ** 2))):.3f} px",
        "recall of the rules": f"{counts.recall:.3f}",
        "1 - precision": f"{1 - counts.precision:.3f}",
        "refined by": f"{pair.refined_inliers} points of dense flow" if pair.refined_inliers else "no dense flow",
        "computed by": pair.backend,
    }
    if pair.confidence:
        rows |= {"confidence": f"{pair.confidence.verdict}: {pair.confidence.reason}"}
    return rows


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
