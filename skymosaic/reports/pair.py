"""The report of a pair: a folder with pictures, the numbers as JSON, and one page that shows both."""

import dataclasses
from pathlib import Path
from typing import Any

from golden_model.arrays import Pixels
from skymosaic.imagery.images import reduce_to_width, save
from skymosaic.registration.pair import Pair
from skymosaic.reports import figures, pages
from skymosaic.temporary import PAGE

MOSAIC_WIDTH_PX = 1600


def write_pair_report(folder: Path, pair: Pair, mosaic: Pixels | None) -> Path:
    """Write pictures, ``report.json`` and ``index.html`` into ``folder``, and return the page's path."""
    pictures = {
        "corners_left.png": ("Corners of the left image", figures.draw_corners(pair.working[0], pair.features[0])),
        "corners_right.png": ("Corners of the right image", figures.draw_corners(pair.working[1], pair.features[1])),
        "matches.png": ("Matches kept and rejected", figures.draw_matches(pair)),
    }
    if mosaic is not None:
        pictures["mosaic.jpg"] = ("Mosaic (reduced)", reduce_to_width(mosaic, MOSAIC_WIDTH_PX)[0])
    numbers = collect_pair_numbers(pair)
    captions = {name: caption for name, (caption, _) in pictures.items()}
    title = f"{Path(pair.left.name).name} and {Path(pair.right.name).name}"
    page = pages.render("pair.html", title=title, rows=_table_rows(numbers), pictures=captions)
    with pages.staged_report(folder) as staged:
        for name, (_, picture) in pictures.items():
            save(staged / name, picture)
        pages.write_report_files(staged, numbers, page)
    return folder / PAGE


def collect_pair_numbers(pair: Pair) -> dict[str, Any]:
    """Collect all numbers and texts of the report, ready for JSON."""
    return {
        "left": _photograph_numbers(pair, 0),
        "right": _photograph_numbers(pair, 1),
        **pair.summary(),
        "configuration": dataclasses.asdict(pair.config),
    }


def _photograph_numbers(pair: Pair, side: int) -> dict[str, Any]:
    photograph = (pair.left, pair.right)[side]
    working = pair.working[side]
    return {
        "name": photograph.name,
        "size": list(photograph.size),
        "working_size": [working.shape[1], working.shape[0]],
        "notes": list(photograph.notes),
    }


def _table_rows(numbers: dict[str, Any]) -> list[tuple[str, str]]:
    """Format the page's table as names and values."""
    shown = {key: value for key, value in numbers.items() if key not in ("configuration", "homography")}
    if numbers["homography"]:
        shown["homography"] = "\n".join("  ".join(f"{h:.8g}" for h in row) for row in numbers["homography"])
    return [(key, _format_value(value)) for key, value in shown.items()]


def _format_value(value: object) -> str:
    if isinstance(value, dict):
        return "\n".join(f"{key}: {_format_value(inner)}" for key, inner in value.items())
    if isinstance(value, list):
        return ", ".join(map(_format_value, value)) or "none"
    return str(value)
