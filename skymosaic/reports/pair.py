"""The report of a pair: a folder with pictures, the numbers as JSON, and one page that shows both."""

from __future__ import annotations

import dataclasses
import html
import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from golden_model.arrays import Pixels
from skymosaic.errors import InputError
from skymosaic.imagery.images import save, save_bytes
from skymosaic.pair import Pair
from skymosaic.reports import figures

_MOSAIC_WIDTH_PX = 1600
PAGE = """<!doctype html>
<html lang="en"><head><meta charset="utf-8"><title>skymosaic: {title}</title>
<style>
body {{ font: 16px/1.5 system-ui, sans-serif; margin: 2rem auto; max-width: 1100px; padding: 0 1rem; color: #222 }}
img {{ max-width: 100%; border-radius: 4px }} figure {{ margin: 1.5rem 0 }} figcaption {{ color: #666 }}
table {{ border-collapse: collapse }} td, th {{ padding: .2rem .9rem .2rem 0; text-align: left; vertical-align: top }}
</style></head><body>
<h1>{title}</h1>
<table>{rows}</table>
{figures}
</body></html>
"""
"""Page of every report, with ``title``, ``rows`` of a table, and ``figures`` as HTML."""


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
    page = _page(f"{Path(pair.left.name).name} and {Path(pair.right.name).name}", numbers, captions)
    save_bytes(folder / "index.html", page.encode())
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


def _page(title: str, numbers: dict[str, Any], captions: dict[str, str]) -> str:
    shown = {key: value for key, value in numbers.items() if key not in ("configuration", "homography")}
    if numbers["homography"]:
        shown["homography"] = "\n".join("  ".join(f"{h:.8g}" for h in row) for row in numbers["homography"])
    rows = "".join(
        f"<tr><th>{html.escape(key)}</th><td style='white-space: pre'>{html.escape(_plain(value))}</td></tr>"
        for key, value in shown.items()
    )
    blocks = "".join(
        f"<figure><img src='{name}' alt='{html.escape(text)}'><figcaption>{html.escape(text)}</figcaption></figure>"
        for name, text in captions.items()
    )
    return PAGE.format(title=html.escape(title), rows=rows, figures=blocks)


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
