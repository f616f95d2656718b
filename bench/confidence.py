"""Fits the predicted error of `skymosaic.registration.confidence`, and shows how well it separates right from wrong.

    python -m bench.confidence --fit SET [--relief 2] --test SET

It is fitted to the rendered pairs with relief of `bench.rendered_pairs` and to the pairs of the ``--fit`` sets, and
judged on those of the ``--test`` sets alone; poor pairs, which its verdict would refuse, are among them. A pair is
wrong from a mean error of 5 px on. The AUC is the probability that a wrong pair gets a larger predicted error than a
right one; without either kind it is not a number.
"""

import math
from collections.abc import Iterator
from typing import Annotated, NamedTuple

import cv2
import numpy as np
import typer
from rich.progress import track
from scipy.optimize import lsq_linear
from scipy.stats import mannwhitneyu

from bench.rendered_pairs import HEIGHTS_PX, OVERLAPS, relief_pairs
from bench.report import JsonFile, Row, public_folder, report
from golden_model.arrays import Array
from skymosaic import register
from skymosaic.evaluation.known_pairs import read_pairs
from skymosaic.evaluation.metrics import grid_error
from skymosaic.geometry.homography import transfer_error
from skymosaic.registration.confidence import (
    COEFFICIENTS,
    GOOD_PX,
    INTERCEPT,
    POOR_PX,
    SURE_CORRELATION,
    Confidence,
    measure_inputs,
)
from skymosaic.registration.pair import Pair

MIN_ERROR_PX = 0.3
"""Smaller errors count as this in the fit: whether a good pair is 0.1 or 0.2 px off does not matter."""
RELIEF_WEIGHT = 3.0
"""Rendered pairs with relief are fewer than flat ones, but have the errors that matter."""
VERDICTS = ("good", "check", "poor")


class Prediction(NamedTuple):
    """An accepted pair: its true error, what the prediction is made of as `COEFFICIENTS`, and what was said of it."""

    error_px: float
    measures: list[float]
    said: Confidence


def prediction(pair: Pair, error_px: float) -> Prediction:
    """What the confidence says of an accepted pair."""
    assert pair.confidence is not None
    values = measure_inputs(pair.confidence.quality, pair.confidence.correlation)
    return Prediction(error_px, [values[name] for name in COEFFICIENTS], pair.confidence)


def predict_relief(each: int) -> Iterator[Prediction]:
    """The rendered pairs; the error is the mean distance to the true positions, relief included."""
    total = each * len(HEIGHTS_PX) * len(OVERLAPS)
    for truth in track(relief_pairs(each), total=total, description="relief"):
        pair = register(truth.left, truth.right, accept_poor=True)
        if pair.homography is not None:
            yield prediction(pair, transfer_error(pair.homography, truth.left_points, truth.right_points).mean())


def predict_sets(names: list[str]) -> Iterator[Prediction]:
    """The pairs of sets that are accepted."""
    for known in track([pair for name in names for pair in read_pairs(public_folder(name))], description="sets"):
        pair = register(known.left, known.right, accept_poor=True)
        if pair.homography is not None:
            yield prediction(pair, grid_error(pair.homography, known.truth, pair.left.size, pair.right.size))


def fit_coefficients(relief: list[Prediction], others: list[Prediction]) -> tuple[Array, float]:
    """Coefficients and intercept of the logarithm of the error; no coefficient may have the wrong sign."""
    pairs = relief + others
    columns = [[*pair.measures, 1.0] for pair in pairs]
    target = np.log([max(pair.error_px, MIN_ERROR_PX) for pair in pairs])
    root = np.sqrt([RELIEF_WEIGHT] * len(relief) + [1.0] * len(others))
    falls = np.array([name == "correlation" for name in COEFFICIENTS] + [False])
    free = np.array([False] * len(COEFFICIENTS) + [True])
    low, high = np.where(falls | free, -np.inf, 0), np.where(falls, 0, np.inf)
    solution = lsq_linear(np.array(columns) * root[:, None], target * root, bounds=(low, high)).x
    return solution[:-1], float(solution[-1])


def area_under_curve(pairs: list[Prediction], predicted_px: Array) -> float:
    """The AUC of predicted errors."""
    wrong = np.array([pair.error_px >= POOR_PX for pair in pairs])
    if wrong.all() or not wrong.any():
        return math.nan
    return float(mannwhitneyu(predicted_px[wrong], predicted_px[~wrong]).statistic / (wrong.sum() * (~wrong).sum()))


def verdict_rows(pairs: list[Prediction]) -> list[Row]:
    """How many pairs of each verdict have which error."""
    rows: list[Row] = []
    for verdict in VERDICTS:
        errors = np.array([pair.error_px for pair in pairs if pair.said.verdict == verdict])
        rows.append(
            {
                "verdict": verdict,
                "pairs": len(errors),
                "under 2 px": int((errors < GOOD_PX).sum()),
                "2 to 5 px": int(((errors >= GOOD_PX) & (errors < POOR_PX)).sum()),
                "5 px and more": int((errors >= POOR_PX).sum()),
                "median": f"{np.median(errors):.2g} px" if len(errors) else "",
            }
        )
    return rows


def main(
    fit: Annotated[list[str], typer.Option(help="Sets of pairs to fit to.")],
    test: Annotated[list[str], typer.Option(help="Sets of pairs to judge by.")],
    relief: Annotated[int, typer.Option(min=1, help="Rendered pairs for each relief and overlap.")] = 2,
    json_file: JsonFile = None,
) -> None:
    """Print the coefficients, and the table of verdicts and the AUC on the test pairs."""
    cv2.setNumThreads(1)
    rendered, flat, unseen = list(predict_relief(relief)), list(predict_sets(fit)), list(predict_sets(test))
    coefficients, intercept = fit_coefficients(rendered, flat)
    print("fitted:", dict(zip(COEFFICIENTS, coefficients.round(3).tolist(), strict=True)), round(intercept, 3))
    print("in use:", COEFFICIENTS, INTERCEPT)
    for title, pairs in (("relief, fitted to", rendered), ("fitted to", flat)):
        report(f"{title}: {len(pairs)} accepted pairs", verdict_rows(pairs))
    report(f"test: {len(unseen)} accepted pairs", verdict_rows(unseen), json_file)
    sure = [pair.error_px for pair in (*rendered, *flat, *unseen) if pair.said.correlation >= SURE_CORRELATION]
    print(f"overlaps that correlate by {SURE_CORRELATION}: {len(sure)}, errors up to {max(sure, default=0):.1f} px")
    values = np.array([pair.measures for pair in unseen])
    predictions = {
        "fitted now": np.exp(values @ coefficients + intercept),
        "in use": np.array([pair.said.predicted_px for pair in unseen]),
    }
    for name, predicted_px in predictions.items():
        print(f"AUC on the test pairs, coefficients {name}: {area_under_curve(unseen, predicted_px):.3f}")


if __name__ == "__main__":
    typer.run(main)
