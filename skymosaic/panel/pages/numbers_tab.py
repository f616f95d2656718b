"""Shows a run in numbers: counts, homography, errors, time, and the command line that repeats it."""

import math

import numpy as np
from nicegui import ui

from golden_model.arrays import Matrix
from skymosaic.evaluation.metrics import confusion
from skymosaic.panel.explain import classify_matches, measure_residuals
from skymosaic.panel.pages.page_layout import fill_in, show_command
from skymosaic.panel.results import MosaicResult
from skymosaic.registration.pair import Pair

CORRECT_PX = 3.0
"""A match this close to the homography counts as correct in recall and precision."""


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
        homography="" if pair.homography is None else _describe(pair.homography),
        quality=_list_quality(pair),
        correct_px=CORRECT_PX,
        seconds=result.seconds,
        facts=result.facts,
    )
    ui.html(markup, sanitize=False).classes("numbers")
    with ui.element("section").classes("card"):
        show_command(result.command)


def _describe(homography: Matrix) -> str:
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
