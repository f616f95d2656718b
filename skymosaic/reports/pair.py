"""The report of a pair: a folder with pictures, the numbers as JSON, and one page that shows both."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from golden_model.arrays import Pixels
from skymosaic.errors import InputError
from skymosaic.imagery.images import save, save_bytes
from skymosaic.registration.pair import Pair
from skymosaic.reports import figures
from skymosaic.reports.pages import render

_MOSAIC_WIDTH_PX = 1600


def prepare(folder: Path) -> None:
    """Make the folder of a report before the long work begins, so that a wrong name is reported at once."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{folder}: cannot be made ({error.strerror}); choose another folder") from None


def write_pair_report(folder: Path, pair: Pair, mosaic: Pixels | None) -> Path:
    """Write pictures, ``report.json`` and ``index.html`` into ``folder``; returns the page's path."""
    prepare(folder)
    pictures = {
        "corners_left.png": ("Corners of the left image", figures.corners(pair.working[0], pair.features[0])),
        "corners_right.png": ("Corners of the right image", figures.corners(pair.working[1], pair.features[1])),
        "matches.png": (
            "Matches kept and rejected",
            figures.matches(pair, pair.method.rule_names(pair.config)),
        ),
    }
    if mosaic is not None:
        pictures["mosaic.jpg"] = ("Mosaic (reduced)", _reduced(mosaic))
    for name, (_, picture) in pictures.items():
        save(folder / name, picture)
    numbers = pair_numbers(pair)
    save_bytes(folder / "report.json", (json.dumps(numbers, indent=2) + "\n").encode())
    captions = {name: caption for name, (caption, _) in pictures.items()}
    title = f"{Path(pair.left.name).name} and {Path(pair.right.name).name}"
    save_bytes(folder / "index.html", render("pair.html", title=title, rows=_rows(numbers), pictures=captions))
    return folder / "index.html"


def pair_numbers(pair: Pair) -> dict[str, Any]:
    """All numbers and texts of the report, ready for JSON."""
    return {
        "left": _photograph(pair, 0),
        "right": _photograph(pair, 1),
        **pair.summary(),
        "configuration": dataclasses.asdict(pair.config),
    }


def _photograph(pair: Pair, side: int) -> dict[str, Any]:
    photograph = (pair.left, pair.right)[side]
    working = pair.working[side]
    return {
        "name": photograph.name,
        "size": list(photograph.size),
        "working_size": [working.shape[1], working.shape[0]],
        "notes": list(photograph.notes),
    }


def _rows(numbers: dict[str, Any]) -> list[tuple[str, str]]:
    """Names and values of the page's table."""
    shown = {key: value for key, value in numbers.items() if key not in ("configuration", "homography")}
    if numbers["homography"]:
        shown["homography"] = "\n".join("  ".join(f"{h:.8g}" for h in row) for row in numbers["homography"])
    return [(key, _plain(value)) for key, value in shown.items()]


def _plain(value: object) -> str:
    if isinstance(value, dict):
        return "\n".join(f"{key}: {_plain(inner)}" for key, inner in value.items())
    if isinstance(value, list):
        return ", ".join(map(_plain, value)) or "none"
    return str(value)


def _reduced(mosaic: Pixels) -> Pixels:
    scale = min(1.0, _MOSAIC_WIDTH_PX / mosaic.shape[1])
    size = (max(1, round(mosaic.shape[1] * scale)), max(1, round(mosaic.shape[0] * scale)))
    return np.asarray(cv2.resize(mosaic, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)
