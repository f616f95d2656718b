"""Fits the predicted error of `skymosaic.registration.confidence`, and shows how well it separates right from wrong.

    python bench/confidence.py --fit DIR [--relief 2] --test DIR [--roc roc.png] [--json FILE]

It is fitted to the rendered pairs with relief of `relief_pairs` and to the pairs of the ``--fit`` folders, and judged
on those of the ``--test`` folders alone. A pair is wrong from a mean error of 5 px on. The AUC is the probability that
a wrong pair gets a larger predicted error than a right one.
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated

import cv2
import numpy as np
import typer
from matplotlib.figure import Figure
from numpy.typing import NDArray
from rich.console import Console
from rich.progress import track
from rich.table import Table
from scipy.optimize import lsq_linear

from known_sets import read_set
from relief_pairs import HEIGHTS_PX, OVERLAPS, relief_pairs
from skymosaic import register
from skymosaic.evaluation.metrics import grid_error
from skymosaic.geometry.homography import apply
from skymosaic.registration.confidence import COEFFICIENTS, INTERCEPT, measure_inputs
from skymosaic.registration.pair import Pair

Array = NDArray[np.float64]

WRONG_PX = 5.0
SMALLEST_PX = 0.3
"""Smaller errors count as this in the fit: whether a good pair is 0.1 or 0.2 px off does not matter."""
RELIEF_WEIGHT = 3.0
"""Rendered pairs with relief are fewer than flat ones, but have the errors that matter."""
VERDICTS = ("good", "check", "poor")


@dataclasses.dataclass(frozen=True)
class Judged:
    """An accepted pair: its true error, what the prediction is made of, the prediction, and the verdict."""

    name: str
    error_px: float
    measures: dict[str, float]
    predicted_px: float
    verdict: str


def judged(name: str, pair: Pair, error_px: float) -> Judged:
    """What the confidence says of an accepted pair."""
    confidence = pair.confidence
    assert confidence is not None
    values = measure_inputs(confidence.quality, confidence.correlation)
    return Judged(name, error_px, values, confidence.predicted_px, confidence.verdict)


def with_relief(each: int) -> Iterator[Judged]:
    """The rendered pairs; the error is the mean distance to the true positions, relief included."""
    total = each * len(HEIGHTS_PX) * len(OVERLAPS)
    for pair in track(relief_pairs(each), total=total, description="relief"):
        found = register(pair.left, pair.right)
        if found.homography is not None:
            distance_px = np.linalg.norm(apply(found.homography, pair.left_points) - pair.right_points, axis=1)
            yield judged(pair.name, found, float(distance_px.mean()))


def of_folder(folder: Path) -> Iterator[Judged]:
    """The pairs of a folder, as `known_sets.read_set` reads it."""
    for pair in track(read_set(folder), description=folder.name):
        found = register(pair.left, pair.right)
        if found.homography is not None:
            error_px = grid_error(found.homography, pair.truth, found.left.size, found.right.size)
            yield judged(pair.name, found, error_px)


def fitted(relief: list[Judged], others: list[Judged]) -> tuple[Array, float]:
    """Coefficients and intercept of the logarithm of the error; no coefficient may have the wrong sign."""
    pairs = relief + others
    columns = [[pair.measures[name] for name in COEFFICIENTS] + [1.0] for pair in pairs]
    target = np.log([max(pair.error_px, SMALLEST_PX) for pair in pairs])
    root = np.sqrt([RELIEF_WEIGHT] * len(relief) + [1.0] * len(others))
    falls = np.array([name == "correlation" for name in COEFFICIENTS] + [False])
    free = np.array([False] * len(COEFFICIENTS) + [True])
    low, high = np.where(falls | free, -np.inf, 0), np.where(falls, 0, np.inf)
    solution = lsq_linear(np.array(columns) * root[:, None], target * root, bounds=(low, high)).x
    return solution[:-1], float(solution[-1])


def predictions(pairs: list[Judged], coefficients: Array, intercept: float) -> Array:
    """Predicted errors, px."""
    values = np.array([[pair.measures[name] for name in COEFFICIENTS] for pair in pairs])
    return np.exp(values @ coefficients + intercept)


def roc(pairs: list[Judged], predicted_px: Array) -> tuple[Array, Array, float]:
    """Share of right pairs that are doubted and of wrong ones that are, by falling limit, and the AUC."""
    wrong = np.array([pair.error_px >= WRONG_PX for pair in pairs])
    order = np.argsort(-predicted_px, kind="stable")
    caught = np.concatenate([[0], np.cumsum(wrong[order]) / max(wrong.sum(), 1)])
    doubted = np.concatenate([[0], np.cumsum(~wrong[order]) / max((~wrong).sum(), 1)])
    return doubted, caught, float(np.trapezoid(caught, doubted))


def by_verdict(title: str, pairs: list[Judged]) -> Table:
    """How many pairs of each verdict have which error."""
    sheet = Table("verdict", "pairs", "under 2 px", "2 to 5 px", "5 px and more", "median px", title=title)
    for verdict in VERDICTS:
        errors = np.array([pair.error_px for pair in pairs if pair.verdict == verdict])
        counts = [(errors < 2).sum(), ((errors >= 2) & (errors < WRONG_PX)).sum(), (errors >= WRONG_PX).sum()]
        sheet.add_row(verdict, str(len(errors)), *map(str, counts), f"{np.median(errors):.2f}" if len(errors) else "")
    return sheet


def draw(path: Path, doubted: Array, caught: Array, area: float) -> None:
    """Write the ROC as a picture."""
    figure = Figure(figsize=(4.5, 4), layout="constrained")
    axes = figure.subplots()
    axes.step(doubted, caught, where="post", color="#1c5d99")
    axes.plot([0, 1], [0, 1], color="#bbb", linewidth=1)
    axes.set(xlabel="right pairs doubted", ylabel="wrong pairs caught", title=f"AUC {area:.2f}")
    figure.savefig(path, dpi=110)


def main(
    fit: Annotated[list[Path], typer.Option(help="Folders of pairs to fit to.")],
    test: Annotated[list[Path], typer.Option(help="Folders of pairs to judge by.")],
    relief: Annotated[int, typer.Option(min=1, help="Rendered pairs for each relief and overlap.")] = 2,
    roc_file: Annotated[Path | None, typer.Option("--roc", help="Write the curve here.")] = None,
    json_file: Annotated[Path | None, typer.Option("--json", help="Write every pair here.")] = None,
) -> None:
    """Print the coefficients, and the table of verdicts and the AUC on the test pairs."""
    cv2.setNumThreads(1)
    console = Console(width=120)
    rendered = list(with_relief(relief))
    flat = [pair for folder in fit for pair in of_folder(folder)]
    unseen = [pair for folder in test for pair in of_folder(folder)]
    coefficients, intercept = fitted(rendered, flat)
    console.print("fitted:", dict(zip(COEFFICIENTS, coefficients.round(3).tolist(), strict=True)), round(intercept, 3))
    console.print("in use:", COEFFICIENTS, INTERCEPT)
    for title, pairs in (("relief, fitted to", rendered), ("fitted to", flat), ("test", unseen)):
        console.print(by_verdict(f"{title}: {len(pairs)} accepted pairs", pairs))
    _, _, area = roc(unseen, predictions(unseen, coefficients, intercept))
    console.print(f"AUC on the test pairs, coefficients fitted now: {area:.3f}")
    doubted, caught, area = roc(unseen, np.array([pair.predicted_px for pair in unseen]))
    console.print(f"AUC on the test pairs, coefficients in use: {area:.3f}")
    if roc_file:
        draw(roc_file, doubted, caught, area)
    if json_file:
        written = {"relief": rendered, "fit": flat, "test": unseen}
        lists = {name: [dataclasses.asdict(pair) for pair in pairs] for name, pairs in written.items()}
        json_file.write_text(json.dumps(lists, indent=1) + "\n")


if __name__ == "__main__":
    typer.run(main)
