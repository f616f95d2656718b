"""The report of a pair: a folder with pictures, the numbers as JSON, and one page that shows both."""

import dataclasses
from pathlib import Path
from typing import Any

from golden_model.arrays import Pixels
from skymosaic.common.options import respell
from skymosaic.common.temporary import PAGE
from skymosaic.imagery.images import reduce_to_width, save
from skymosaic.registration.pair import Pair
from skymosaic.reports import figures, pages

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
    page = pages.render("pair.html", title=title, rows=_table_rows(pair), pictures=captions)
    with pages.staged_report(folder) as staged:
        for name, (_, picture) in pictures.items():
            save(staged / name, picture)
        pages.write_report_files(staged, numbers, page)
    return folder / PAGE


def collect_pair_numbers(pair: Pair) -> dict[str, Any]:
    """Collect all numbers and texts of the report, ready for JSON."""
    photographs = {
        side: {
            "name": photograph.name,
            "size": list(photograph.size),
            "working_size": [working.shape[1], working.shape[0]],
            "notes": list(photograph.notes),
        }
        for side, photograph, working in zip(("left", "right"), (pair.left, pair.right), pair.working, strict=True)
    }
    return {**pair.summary(), **photographs, "configuration": dataclasses.asdict(pair.config)}


def _table_rows(pair: Pair) -> list[tuple[str, str]]:
    """What the page says about a pair, as names and words."""
    rows = []
    for side, photograph in (("left", pair.left), ("right", pair.right)):
        size = "x".join(map(str, photograph.size))
        rows.append((side, "; ".join([f"{Path(photograph.name).name}, {size} px", *photograph.notes])))
    rows.append(("verdict", "accepted" if pair.accepted else f"refused: {respell(pair.reason)}"))
    if pair.confidence is not None:
        rows.append(("confidence", f"{pair.confidence.verdict}: {pair.confidence.reason}"))
    left, right = map(len, pair.features)
    rows += [
        ("corners", f"{left} and {right}"),
        ("matches", f"{len(pair.matches)}, {len(pair.kept)} kept by the rules, {len(pair.inliers)} on the homography"),
    ]
    if pair.refined_inliers:
        rows.append(("refit", f"to {pair.refined_inliers} points of dense flow"))
    if pair.homography is not None:
        matrix = "\n".join("  ".join(f"{value:.8g}" for value in row) for row in pair.homography)
        rows.append(("homography, left to right, px", matrix))
    method = pair.method
    return [
        *rows,
        ("method", f"{method.detector} + {method.descriptor}, {pair.estimator}; passes: {pair.passes} ({pair.effort})"),
        ("computed by", pair.backend),
        ("time", ", ".join(f"{stage} {seconds:.2f} s" for stage, seconds in pair.seconds.items())),
    ]
