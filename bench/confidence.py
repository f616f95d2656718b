"""Fits the table by which `skymosaic.registration.confidence` judges a pair, and shows what it is worth.

    python -m bench.confidence FLIGHT FLIGHT ... --set SET [--set SET ...] [--write]

The pairs: those of the sets, the rendered ones with and without relief of `bench.rendered_pairs`, and those of
`bench.flight_pairs`, cut out of flights. Poor pairs are among them. The figures are of pairs that had no part
in the fit, by turns; the table that ``--write`` stores is fitted to all of them.
"""

import json
import math
from collections.abc import Iterator
from datetime import UTC, datetime
from itertools import chain, pairwise
from pathlib import Path
from typing import Annotated, NamedTuple

import cv2
import numpy as np
import typer
from rich.progress import track
from scipy.optimize import lsq_linear, minimize

from bench.flight_pairs import WRONG_PX, confusing_pairs, neighbouring_pairs, read_flight
from bench.rendered_pairs import STEPS, flat_pairs, relief_pairs
from bench.report import Flights, JsonFile, Row, public_folder, report
from golden_model.arrays import Array, Mask, Matrix, Pixels
from skymosaic import register
from skymosaic.evaluation.known_pairs import read_pairs
from skymosaic.evaluation.metrics import grid_error
from skymosaic.geometry.homography import transfer_error
from skymosaic.imagery.images import load
from skymosaic.registration.confidence import FORMAT, GOOD_PX, MAX_DOUBT, POOR_PX, TABLE, Evidence, name_verdict
from skymosaic.registration.display import look_behind_display
from skymosaic.registration.pair import Pair

ENDS = ("good", "check", "poor", "refused")
KNOTS = {
    "held_out_share": (0, 0.25, 0.5, 0.65, 0.8, 0.9, 0.97, 1),
    "hull_share": (0, 0.1, 0.2, 0.4, 0.6, 0.75, 0.9, 1),
    "motion": (0, 0.0005, 0.002, 0.01),
    "ground_share": (0, 0.2, 0.4, 0.6, 0.8, 0.9, 0.97, 1),
    "inliers": (8, 1000),
    "ground_lack": (0.6, 0.4, 0.2, 0.05, 0),
    "rival": (1.05, 0.99, 0.97, 0.93, 0.85, 0.7),
}
"""Where the table has values, from what speaks against a pair to what speaks for it."""
MIN_ERROR_PX, MAX_ERROR_PX = 0.05, 30.0
"""Smaller and larger errors count as these in the fit of the error."""
RIDGE_OF_ODDS, RIDGE_OF_ERROR = 0.05, 0.1
FOLDS = 8
STATED = 0.9
"""Share of the pairs that stay below what is predicted."""
MIN_GROUP = 40
"""Pairs that one predicted error is read from, at least."""


class Candidate(NamedTuple):
    """A homography that was found: its group, its true error in working px, and what speaks for it."""

    group: str
    error_px: float
    evidence: Evidence


def candidates(sets: list[str], flights: list[str], each: int) -> Iterator[Candidate]:
    """What is found of all pairs, right or wrong, refused or not."""
    for known in chain.from_iterable(read_pairs(public_folder(name)) for name in sets):
        yield from _find(known.group, load(known.left).pixels, load(known.right).pixels, known.truth)
    for kind in STEPS:
        for _, group, left, right, truth in flat_pairs(kind, each):
            yield from _find(group, left, right, truth)
    for relief in relief_pairs(each):
        pair = register(relief.left, relief.right, accept_poor=True)
        if pair.homography is not None and pair.evidence:
            error_px = transfer_error(pair.homography, relief.left_points, relief.right_points).mean()
            yield Candidate("relief", float(error_px), pair.evidence)
    photographs = [read_flight(public_folder(name), 12) for name in flights]
    for exact in chain(confusing_pairs(photographs, 4 * each), neighbouring_pairs(photographs)):
        yield from _find(exact.group, exact.left, exact.right, exact.truth)


def _find(group: str, left: Pixels, right: Pixels, truth: Matrix | None) -> Iterator[Candidate]:
    pair = register(left, right, accept_poor=True)
    # What rests on a display is refused by a rule.
    if pair.evidence is not None and look_behind_display(pair, pair.matches).accepted:
        yield Candidate(group, _error_px(pair, truth), pair.evidence)


def _error_px(pair: Pair, truth: Matrix | None) -> float:
    """Mean error over the overlap, px of the working image; infinite between different places."""
    if truth is None:
        return math.inf
    error_px = grid_error(pair.homography, truth, pair.left.size, pair.right.size)
    return float(error_px / pair.to_original[1][0, 0])


class Fit(NamedTuple):
    """Steps from knot to knot, none of which rises, and a constant: of the log odds, and of the log error."""

    odds: Array
    error: Array


def expand(evidence: list[Evidence]) -> Array:
    """How much of the way between each two knots the evidence is, and a column of ones."""
    columns = []
    for name, knots in KNOTS.items():
        values = np.array([getattr(each, name) for each in evidence])
        columns += [np.clip((values - low) / (high - low), 0, 1) for low, high in pairwise(knots)]
    return np.stack([*columns, np.ones(len(evidence))], axis=1)


def fit_steps(steps: Array, errors_px: Array) -> Fit:
    """Logistic regression of whether a pair is off by `WRONG_PX`, and least squares of the logarithm of its error."""
    wrong, ridge = (errors_px > WRONG_PX).astype(float), np.ones(steps.shape[1])
    ridge[-1] = 0

    def loss(fit: Array) -> tuple[float, Array]:
        odds = steps @ fit
        value = np.sum(np.logaddexp(0, odds) - wrong * odds) + RIDGE_OF_ODDS * np.sum(ridge * fit**2) / 2
        return float(value), steps.T @ (1 / (1 + np.exp(-odds)) - wrong) + RIDGE_OF_ODDS * ridge * fit

    most = [0.0] * (len(ridge) - 1) + [np.inf]
    bounds = [(None, limit) for limit in most]
    odds = minimize(loss, np.zeros(len(ridge)), jac=True, bounds=bounds, method="L-BFGS-B").x
    rows = np.concatenate([steps, np.diag(RIDGE_OF_ERROR * ridge) ** 0.5])
    target = np.log(np.clip(errors_px, MIN_ERROR_PX, MAX_ERROR_PX))
    error = lsq_linear(rows, np.append(target, 0 * ridge), bounds=(-np.inf, most)).x
    return Fit(odds, error)


def stated_errors(sums: Array, errors_px: Array) -> tuple[Array, Array]:
    """What nine of ten pairs of a group with like sums stay below: the middle of each group, and the error, rising."""
    order = np.argsort(sums)
    groups = np.array_split(order, max(len(order) // MIN_GROUP, 1))
    stated = np.maximum.accumulate([np.quantile(errors_px[group], STATED, method="higher") for group in groups])
    return np.array([np.median(sums[group]) for group in groups]), np.minimum(stated, MAX_ERROR_PX)


def predict_held_out(steps: Array, errors_px: Array) -> tuple[Array, Array]:
    """Doubt and predicted error of each pair by a table that is fitted to others."""
    fold = np.random.default_rng(0).integers(0, FOLDS, len(steps))
    doubt, predicted_px = np.zeros(len(steps)), np.zeros(len(steps))
    for number in range(FOLDS):
        out: Mask = fold == number
        fit = fit_steps(steps[~out], errors_px[~out])
        doubt[out] = 1 / (1 + np.exp(-steps[out] @ fit.odds))
        right = ~out & (errors_px < MAX_ERROR_PX)
        predicted_px[out] = np.interp(
            steps[out] @ fit.error, *stated_errors(steps[right] @ fit.error, errors_px[right])
        )
    return doubt, predicted_px


def name_ends(doubt: Array, predicted_px: Array) -> list[str]:
    """The verdict of each pair, or that it is refused."""
    each = zip(doubt.tolist(), predicted_px.tolist(), strict=True)
    return ["refused" if chance > MAX_DOUBT else name_verdict(chance, px) for chance, px in each]


def verdict_rows(doubt: Array, predicted_px: Array, errors_px: Array) -> list[Row]:
    """How many pairs of each verdict have which error."""
    said = name_ends(doubt, predicted_px)
    kinds = {end: np.array(said) == end for end in ENDS}
    return [
        {
            "verdict": verdict,
            "pairs": int(chosen.sum()),
            "under 2 px": int((errors_px[chosen] < GOOD_PX).sum()),
            "2 to 5 px": int(((errors_px[chosen] >= GOOD_PX) & (errors_px[chosen] < POOR_PX)).sum()),
            "5 px and more": int((errors_px[chosen] >= POOR_PX).sum()),
            "below what is predicted": f"{100 * np.mean(errors_px[chosen] <= predicted_px[chosen]):.0f} %",
            "predicted over true": ""
            if verdict == "refused"
            else f"{np.median((predicted_px / errors_px)[chosen]):.1f}",
        }
        for verdict, chosen in kinds.items()
    ]


def group_rows(pairs: list[Candidate], doubt: Array, predicted_px: Array) -> list[Row]:
    """How many pairs of each group are right, by less than `POOR_PX`, and wrong; how many are delivered, and good."""
    rows, said = list[Row](), name_ends(doubt, predicted_px)
    for name in sorted({pair.group for pair in pairs}):
        row: Row = {"pairs": name.replace("_", " ")}
        for word, is_right in (("right", True), ("wrong", False)):
            chosen = [k for k, pair in enumerate(pairs) if pair.group == name and (pair.error_px < POOR_PX) == is_right]
            ends = [said[k] for k in chosen if said[k] != "refused"]
            row |= {word: len(chosen), f"{word}, delivered (good)": f"{len(ends)} ({ends.count('good')})"}
        rows.append(row)
    return rows


def write_table(pairs: list[Candidate], steps: Array, errors_px: Array, sets: list[str]) -> None:
    """Fit to all pairs and store the table."""
    fit, inputs, place = fit_steps(steps, errors_px), {}, 0
    for name, knots in KNOTS.items():
        part = slice(place, place + len(knots) - 1)
        place = part.stop
        values = (np.append(0, np.cumsum(each[part])).round(3) for each in fit)
        columns = [np.array(knots, float), *values]
        turned = [column[:: 1 if knots[-1] > knots[0] else -1].tolist() for column in columns]
        inputs[name] = dict(zip(("at", "log_odds", "log_error"), turned, strict=True))
    right = errors_px < MAX_ERROR_PX
    sums, stated = stated_errors(steps[right] @ fit.error, errors_px[right])
    names = sorted({pair.group for pair in pairs})
    table = {
        "format": FORMAT,
        "fitted": datetime.now(UTC).date().isoformat(),
        "sets": sets,
        "pairs": {name: sum(pair.group == name for pair in pairs) for name in names},
        "inputs": inputs,
        "log_odds": round(float(fit.odds[-1]), 3),
        "sums": (sums - fit.error[-1]).round(3).tolist(),
        "errors_px": stated.round(3).tolist(),
    }
    TABLE.write_text(json.dumps(table, indent=1) + "\n")


def main(
    flights: Flights,
    *,
    sets: Annotated[list[str], typer.Option("--set", help="Sets of pairs besides.")],
    each: Annotated[int, typer.Option(min=1, help="Rendered pairs of each step.")] = 4,
    write: Annotated[bool, typer.Option("--write", help="Store the table.")] = False,
    json_file: JsonFile = None,
    groups_file: Annotated[Path | None, typer.Option("--groups-json", help="As --json, of the second table.")] = None,
) -> None:
    """Print what the table is worth on pairs that had no part in it, and perhaps store one that is fitted to all."""
    cv2.setNumThreads(1)
    pairs = list(track(candidates(sets, list(flights), each), description="pairs", total=None))
    errors_px, steps = np.array([pair.error_px for pair in pairs]), expand([pair.evidence for pair in pairs])
    doubt, predicted_px = predict_held_out(steps, errors_px)
    report(f"{len(pairs)} pairs, each judged by others", verdict_rows(doubt, predicted_px, errors_px), json_file)
    report("the same by group", group_rows(pairs, doubt, predicted_px), groups_file)
    for pair, chance, px in zip(pairs, doubt, predicted_px, strict=True):
        if pair.error_px > WRONG_PX and chance <= MAX_DOUBT:
            print(f"not refused: {pair.group}, {pair.error_px:.1f} px off, doubt {chance:.2f}, predicted {px:.1f} px")
    if write:
        write_table(pairs, steps, errors_px, [*sets, *flights])


if __name__ == "__main__":
    typer.run(main)
