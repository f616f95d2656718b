"""How often, and how closely, pairs with a known homography are registered, beside OpenCV's methods in one run.

    python bench/registration.py --data DIR [--data DIR ...] [--seeds 5] [--method NAME ...] [--json FILE]

DIR holds pairs.csv (name, group, left, right, h00 ... h22; the homography maps left to right pixels), or folders with
img1 ... img6 and H1to2p ... H1to6p as the Oxford and HPatches sets have them. The error of a pair is the mean distance
over a 20x20 grid of left points that fall inside the right image; 1000 where nothing was estimated or accepted.

A share is the mean over the seeds; where it differs between seeds, lowest and highest follow. mAA is the mean of the
shares under 1, 2, ... 10 px. Wrong: accepted and more than 20 px off, at any seed. Times are of processor time.
"""

from __future__ import annotations

import dataclasses
import json
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import cv2
import numpy as np
import typer
from numpy.typing import NDArray
from rich.console import Console
from rich.progress import track
from rich.table import Table

from baselines import BASELINES, ESTIMATORS, Baseline
from known_sets import read_set
from remembering import RememberingBackend
from skymosaic import register
from skymosaic.evaluation.known_pairs import KnownPair
from skymosaic.evaluation.metrics import MISSING_ERROR_PX, grid_error

LIMITS_PX = (1, 3, 5)
WRONG_PX = 20.0
FEW_FEATURES, MANY_FEATURES = 1000, 8000
OURS: dict[str, dict[str, Any]] = {
    "normal": {},
    "fast": {"effort": "fast"},
    "thorough": {"effort": "thorough"},
    "refine": {"refine": True},
    "scored": {"estimator": "scored"},
    "scored-fast": {"estimator": "scored", "effort": "fast"},
    "fast-corners": {"detector": "fast"},
    "thesis": {"preset": "thesis"},
}
"""Rows of this project, with the options of `skymosaic.register` behind them."""

Matrix = NDArray[np.float64]
Method = Callable[[KnownPair, int], Iterator[tuple[Matrix | None, int]]]
"""Homography and inliers of a pair, once for each of so many seeds."""


@dataclass(frozen=True)
class Outcome:
    """What a method made of one pair: an error for each seed; inliers and processor time of the first."""

    pair: str
    group: str
    flight: str
    error_px: tuple[float, ...]
    inliers: int
    seconds: float


def ours(**options: Any) -> Method:
    """The project's own registration; what front end and matcher found is kept for the other seeds."""

    def run(pair: KnownPair, seeds: int) -> Iterator[tuple[Matrix | None, int]]:
        backend = RememberingBackend() if "detector" not in options and "preset" not in options else "golden"
        for seed in range(seeds):
            found = register(pair.left, pair.right, seed=seed, backend=backend, **options)
            yield found.homography, len(found.inliers)

    return run


def baseline(name: str, count: int, estimator: str = "magsac") -> Method:
    """An OpenCV method on the same files; its seed is fixed."""
    method = Baseline(name, count, estimator)

    def run(pair: KnownPair, _seeds: int) -> Iterator[tuple[Matrix | None, int]]:
        yield method.homography(*map(_gray, (pair.left, pair.right)))

    return run


def measure(method: Method, pairs: list[KnownPair], seeds: int, label: str) -> Iterator[Outcome]:
    """Run ``method`` on every pair."""
    for pair in track(pairs, description=f"{label:>22}", console=Console(stderr=True), transient=True):
        left_size, right_size = (_gray(path).shape[::-1] for path in (pair.left, pair.right))
        errors, inliers, seconds = [], 0, 0.0
        start = time.process_time()
        for found, support in method(pair, seeds):
            if not errors:
                inliers, seconds = support, time.process_time() - start
            error = grid_error(found, pair.truth, left_size, right_size)
            errors.append(min(error, MISSING_ERROR_PX - 1) if found is not None else MISSING_ERROR_PX)
        yield Outcome(pair.name, pair.group, pair.flight, tuple(errors), inliers, seconds)


def _gray(path: Path) -> NDArray[np.uint8]:
    return cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)


def shares(outcomes: list[Outcome]) -> str:
    """Percent of pairs under each limit: mean over the seeds, and the range where they differ."""
    errors = np.array([outcome.error_px for outcome in outcomes])
    by_seed = [100 * np.mean(errors < limit, axis=0) for limit in LIMITS_PX]
    return " / ".join(
        f"{share.mean():.0f}" + (f" ({share.min():.0f}-{share.max():.0f})" if np.ptp(share) > 0 else "")
        for share in by_seed
    )


def mean_average_accuracy(outcomes: list[Outcome]) -> float:
    """Mean of the shares under 1, 2, ... 10 px, percent."""
    errors = np.array([outcome.error_px for outcome in outcomes])
    return 100 * float(np.mean([np.mean(errors < limit) for limit in range(1, 11)]))


def by_column(title: str, results: dict[str, list[Outcome]], column: str) -> Table:
    """Shares of pairs under each limit, by the values of one column (group or flight)."""
    sheet = Table(title=title)
    values = sorted({getattr(outcome, column) for outcomes in results.values() for outcome in outcomes})
    for heading in ("method", *values):
        sheet.add_column(heading, justify="left" if heading == "method" else "right")
    for method, outcomes in results.items():
        sheet.add_row(method, *(shares([o for o in outcomes if getattr(o, column) == value]) for value in values))
    return sheet


def overall(title: str, results: dict[str, list[Outcome]]) -> Table:
    """One row a method: accuracy over all pairs, refused and wrong ones, inliers and time."""
    sheet = Table(title=title)
    measured = ("mAA 10", "median px", "refused", "wrong", "inliers", "ms, median", "ms, mean", "/ SIFT")
    for heading in ("method", "all", *measured):
        sheet.add_column(heading, justify="left" if heading == "method" else "right")
    sift = results.get(f"sift {FEW_FEATURES}")
    for method, outcomes in results.items():
        errors = np.array([outcome.error_px for outcome in outcomes])
        seconds = np.array([outcome.seconds for outcome in outcomes])
        refused = (errors == MISSING_ERROR_PX).sum(axis=0).mean()
        wrong = ((errors > WRONG_PX) & (errors < MISSING_ERROR_PX)).any(axis=1).sum()
        ratio = f"{np.median(seconds / [outcome.seconds for outcome in sift]):.2f}" if sift else ""
        sheet.add_row(
            method,
            shares(outcomes),
            f"{mean_average_accuracy(outcomes):.1f}",
            f"{np.median(errors):.3f}",
            f"{refused:.1f}",
            str(wrong),
            f"{np.median([outcome.inliers for outcome in outcomes]):.0f}",
            f"{1000 * np.median(seconds):.0f}",
            f"{1000 * np.mean(seconds):.0f}",
            ratio,
        )
    return sheet


def unstable(outcomes: list[Outcome], limit_px: float = 5.0) -> list[str]:
    """Pairs that are right at one seed, and accepted but more than 20 px off at another."""
    found = []
    for outcome in outcomes:
        given = [error for error in outcome.error_px if error < MISSING_ERROR_PX]
        if given and min(given) < limit_px and max(given) > WRONG_PX:
            found.append(outcome.pair)
    return found


def rows(wanted: list[str] | None) -> dict[str, Method]:
    """The methods to run, by the name of their row; ``wanted`` are first words of it (None: all)."""
    every = {name: ours(**options) for name, options in OURS.items()}
    every |= {f"{name} {FEW_FEATURES}": baseline(name, FEW_FEATURES) for name in BASELINES}
    every |= {f"{name} {MANY_FEATURES}": baseline(name, MANY_FEATURES) for name in ("sift", "rootsift")}
    every |= {
        f"sift-{estimator} {MANY_FEATURES}": baseline("sift", MANY_FEATURES, estimator)
        for estimator in ESTIMATORS
        if estimator != "magsac"
    }
    names = dict.fromkeys(name.split()[0] for name in every)
    unknown = [name for name in wanted or () if name not in names]
    if unknown:
        raise typer.BadParameter(f"no method {', '.join(unknown)}; valid: {', '.join(names)}")
    return {name: run for name, run in every.items() if not wanted or name.split()[0] in wanted}


def main(
    data: Annotated[list[Path], typer.Option(help="Folder with pairs.csv, or of sequences; several are joined.")],
    seeds: Annotated[int, typer.Option(min=1, help="Seeds of our estimator; OpenCV's are fixed.")] = 5,
    method: Annotated[list[str] | None, typer.Option(help="Only these: normal, thorough, refine, sift, ...")] = None,
    json_file: Annotated[Path | None, typer.Option("--json", help="Write every outcome here.")] = None,
) -> None:
    """Print the table of results."""
    cv2.setNumThreads(1)
    console = Console(width=200)
    pairs = [pair for folder in data for pair in read_set(folder)]
    results: dict[str, list[Outcome]] = {}
    for name, run in rows(method).items():
        results[name] = list(measure(run, pairs, seeds, name))
        if json_file:
            written = {name: [dataclasses.asdict(outcome) for outcome in given] for name, given in results.items()}
            json_file.write_text(json.dumps(written, indent=1) + "\n")
    note = f"{len(pairs)} pairs, {seeds} seeds; shares under {'/'.join(map(str, LIMITS_PX))} px in %"
    console.print(by_column(f"by group: {note}", results, "group"))
    console.print(by_column(f"by flight: {note}", results, "flight"))
    console.print(overall(note, results))
    for name, outcomes in results.items():
        if pairs_off := unstable(outcomes):
            console.print(f"{name}: right at one seed and more than {WRONG_PX:g} px off at another: {pairs_off}")


if __name__ == "__main__":
    typer.run(main)
