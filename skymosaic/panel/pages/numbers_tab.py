"""Shows a run in numbers: counts, homography, errors, time, and the command line that repeats it."""

import math
from collections.abc import Mapping
from html import escape

import numpy as np
from nicegui import ui

from skymosaic.evaluation.metrics import confusion
from skymosaic.panel.explain import classify_matches, measure_residuals
from skymosaic.panel.pages.page_layout import show_command
from skymosaic.panel.results import MosaicResult
from skymosaic.registration.pair import Pair

CORRECT_PX = 3.0
"""A match this close to the homography counts as correct in recall and precision."""


def build_numbers_tab(result: MosaicResult) -> None:
    """Show the numbers of a run and of the pair that is shown."""
    pair = result.pair
    with ui.element("div").classes("numbers"):
        for title, body in (
            ("From corners to inliers", _funnel(pair)),
            ("Homography, left to right, in pixels of the originals", _homography(pair)),
            ("Quality", _quality(pair)),
            ("Time", _bars(result.seconds, "{:.3f} s")),
            *((("The mosaic", _table(result.facts)),) if result.facts else ()),
        ):
            ui.html(f"<h3>{title}</h3>{body}", tag="section", sanitize=False).classes("card")
    with ui.element("section").classes("card"):
        show_command(result.command)


def _funnel(pair: Pair) -> str:
    left, right = map(len, pair.features)
    counts = {
        "corners, left": left,
        "corners, right": right,
        "mutual matches": len(pair.matches),
        "kept by the rules": len(pair.kept),
        "inliers at 2 px": len(pair.inliers),
    }
    return _bars(counts, "{:.0f}")


def _bars(values: Mapping[str, float], form: str) -> str:
    # Never zero: a run without any corner has bars without length.
    largest = max([*values.values(), 1e-9])
    rows = "".join(
        f'<tr><th>{escape(name)}</th><td>{form.format(value)}</td><td class="wide"><span class="bar-of" '
        f'style="--share:{value / largest:.3f}"></span></td></tr>'
        for name, value in values.items()
    )
    return f'<table class="bars">{rows}</table>'


def _homography(pair: Pair) -> str:
    if pair.homography is None:
        return f"<p class='fault'>{escape(pair.reason)}</p>"
    cells = "".join("<tr>" + "".join(f"<td>{value: .6g}</td>" for value in row) + "</tr>" for row in pair.homography)
    return f'<table class="matrix">{cells}</table><p class="hint">{_describe(pair.homography)}</p>'


def _describe(homography: np.ndarray) -> str:
    """Rotation, scale and shift of the homography at the image's first pixel, in words."""
    (a, b, x), (c, d, y), _ = homography
    scale = math.sqrt(abs(a * d - b * c))
    rotation = math.degrees(math.atan2(c - b, a + d))
    return f"projective, 8 parameters: rotates by {rotation:.2f}°, scales by {scale:.4f}, shifts by {x:.1f}, {y:.1f} px"


def _quality(pair: Pair) -> str:
    residual_px = measure_residuals(pair)
    if residual_px is None:
        return "<p class='hint'>Nothing to measure without a homography.</p>"
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
    return f'{_table(rows)}<p class="hint">Correct: within {CORRECT_PX:g} px of the homography.</p>'


def _table(rows: Mapping[str, str]) -> str:
    body = "".join(f"<tr><th>{name}</th><td>{escape(value)}</td></tr>" for name, value in rows.items())
    return f'<table class="bars words">{body}</table>'
