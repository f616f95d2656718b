"""How fast the panel answers: its start, the first mosaic, and corners after the threshold slider.

    python -m bench.panel

Runs the panel and headless Chromium. The slider goes through half of its range by key presses on the built-in pair; a
step ends with the first frame that shows other corners.
"""

import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import typer

from bench.report import JsonFile, Row, report
from tools.panel import (
    chromium,
    load_built_in_pair,
    make_mosaic,
    open_page,
    running_panel,
    threshold_to_corners_ms,
)

SLIDER_KEYS = ("ArrowLeft",) * 7 + ("ArrowRight",) * 14 + ("ArrowLeft",) * 7
"""From the middle of the range down, up beyond the middle, and back."""


def main(json_file: JsonFile = None) -> None:
    """Measure with one panel and one browser."""
    with tempfile.TemporaryDirectory() as folder, chromium() as browser:
        started = time.perf_counter()
        with running_panel(Path(folder)) as address:
            start_ms = 1000 * (time.perf_counter() - started)
            page = open_page(browser, address)
            started = time.perf_counter()
            load_built_in_pair(page)
            make_mosaic(page)
            first_ms = 1000 * (time.perf_counter() - started)
            page.context.close()
            page = open_page(browser, address)
            load_built_in_pair(page)
            steps_ms = threshold_to_corners_ms(page, SLIDER_KEYS)
            page.context.close()
    rows = [
        row("from the command to its address", [start_ms]),
        row("from the open page to the first mosaic, the built-in pair rendered", [first_ms]),
        row(f"from a step of the threshold slider to the corners, {len(steps_ms)} steps", steps_ms),
    ]
    report("panel", rows, json_file)


def row(title: str, milliseconds: Sequence[float]) -> Row:
    """Median and longest of some times."""
    return {"time": title, "median, ms": round(np.median(milliseconds)), "longest, ms": round(max(milliseconds))}


if __name__ == "__main__":
    typer.run(main)
