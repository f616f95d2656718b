"""Shows a run in numbers: counts, homography, errors, time, and the command line that repeats it."""

import math
from collections.abc import Mapping
from html import escape

import numpy as np
from nicegui import ui

from skymosaic.evaluation.metrics import confusion
from skymosaic.panel.pages.page_layout import show_command
from skymosaic.panel.pair_view import PairView
from skymosaic.panel.results import MosaicResult

CORRECT_PX = 3.0
"""A match this close to the homography counts as correct in recall and precision."""


def build_numbers_tab(result: MosaicResult) -> None:
    """Show the numbers of a run and of the pair that is shown."""
    view = result.pair
    with ui.element("div").classes("numbers"):
        for title, body in (
            ("From corners to inliers", _funnel(view)),
            ("Homography, left to right, in pixels of the originals", _homography(view)),
            ("Quality", _quality(view)),
            ("Time", _bars(result.seconds, "{:.3f} s")),
            *((("The mosaic", _table(result.facts)),) if result.facts else ()),
        ):
            ui.html(f"<h3>{title}</h3>{body}", tag="section", sanitize=False).classes("card")
    with ui.element("section").classes("card"):
        show_command(result.command)


def _funnel(view: PairView) -> str:
    left, right = (len(features) for features in view.features)
    counts = {
        "corners, left": left,
        "corners, right": right,
        "mutual matches": len(view.matches),
        "kept by the rules": int(view.kept.sum()),
        "inliers at 2 px": int(view.inlier.sum()),
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


def _homography(view: PairView) -> str:
    rows = view.numbers["homography"]
    if rows is None:
        return f"<p class='fault'>{escape(view.numbers['reason'])}</p>"
    cells = "".join("<tr>" + "".join(f"<td>{value: .6g}</td>" for value in row) + "</tr>" for row in rows)
    return f'<table class="matrix">{cells}</table><p class="hint">{_describe(np.array(rows))}</p>'


def _describe(homography: np.ndarray) -> str:
    """Rotation, scale and shift of the homography at the image's first pixel, in words."""
    (a, b, x), (c, d, y), _ = homography
    scale = math.sqrt(abs(a * d - b * c))
    rotation = math.degrees(math.atan2(c - b, a + d))
    return f"projective, 8 parameters: rotates by {rotation:.2f}°, scales by {scale:.4f}, shifts by {x:.1f}, {y:.1f} px"


def _quality(view: PairView) -> str:
    if view.residual_px is None:
        return "<p class='hint'>Nothing to measure without a homography.</p>"
    inliers = view.residual_px[view.inlier]
    counts = confusion(view.kept, view.residual_px <= CORRECT_PX)
    rows = {
        "RMSE of the inliers": f"{math.sqrt(float(np.mean(inliers**2))):.3f} px",
        "recall of the rules": f"{counts.recall:.3f}",
        "1 - precision": f"{1 - counts.precision:.3f}",
        "refined by": f"{view.numbers['refined_inliers']} points of dense flow"
        if view.numbers["refined_inliers"]
        else "no dense flow",
        "computed by": view.numbers["backend"],
    }
    if confidence := view.numbers["confidence"]:
        rows |= {"confidence": f"{confidence['verdict']}: {confidence['reason']}"}
    return f'{_table(rows)}<p class="hint">Correct: within {CORRECT_PX:g} px of the homography.</p>'


def _table(rows: Mapping[str, str]) -> str:
    body = "".join(f"<tr><th>{name}</th><td>{escape(value)}</td></tr>" for name, value in rows.items())
    return f'<table class="bars words">{body}</table>'
