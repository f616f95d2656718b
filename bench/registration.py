"""How often, and how closely, pairs with a known homography are registered, beside OpenCV's methods in one run.

    python bench/registration.py --data DIR [--method NAME ...] [--negatives] [--refine] [--json FILE]

DIR holds pairs.csv (name, group, left, right, h00 ... h22; the homography maps left to right pixels). The error of a
pair is the mean distance over a 20x20 grid of left points that fall inside the right image; 1000 where nothing
was estimated.
"""

from __future__ import annotations

import dataclasses
import json
import random
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

from baselines import BASELINES, Baseline
from golden_model.arrays import Matrix
from skymosaic import register
from skymosaic.evaluation.known_pairs import KnownPair, read_pairs
from skymosaic.evaluation.metrics import grid_error

NOTHING_ESTIMATED_PX = 1000.0
LIMITS_PX = (1, 3, 5)
FEW_FEATURES = 1000
NEGATIVE_PAIRS = 100

Method = Callable[[Path, Path], tuple[Matrix | None, int]]


@dataclass(frozen=True)
class Outcome:
    """What a method made of one pair."""

    pair: str
    group: str
    flight: str
    error_px: float
    inliers: int
    seconds: float


def ours(**options: Any) -> Method:
    """The project's own registration with these options; a pair it does not accept counts as not estimated."""

    def run(left: Path, right: Path) -> tuple[Matrix | None, int]:
        pair = register(left, right, **options)
        return pair.homography, len(pair.inliers)

    return run


def baseline(name: str, count: int) -> Method:
    """A baseline on the same files."""
    method = Baseline(name, count)

    def run(left: Path, right: Path) -> tuple[Matrix | None, int]:
        return method.homography(*map(_gray, (left, right)))

    return run


def measure(method: Method, pairs: list[KnownPair], label: str) -> Iterator[Outcome]:
    """Run ``method`` on every pair."""
    for pair in track(pairs, description=f"{label:>22}", console=Console(stderr=True), transient=True):
        start = time.perf_counter()
        found, inliers = method(pair.left, pair.right)
        seconds = time.perf_counter() - start
        left_size, right_size = (_gray(path).shape[::-1] for path in (pair.left, pair.right))
        error = NOTHING_ESTIMATED_PX if found is None else grid_error(found, pair.truth, left_size, right_size)
        yield Outcome(pair.name, pair.group, pair.flight, error, inliers, seconds)


def _gray(path: Path) -> NDArray[np.uint8]:
    return cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)


def table(title: str, results: dict[str, list[Outcome]], column: str) -> Table:
    """Shares of pairs under each limit, by the values of one column (group or flight) and over all."""
    sheet = Table(title=title)
    values = sorted({getattr(outcome, column) for outcomes in results.values() for outcome in outcomes})
    for heading in ("method", *values, "all", "median px", "inliers", "ms a pair"):
        sheet.add_column(heading, justify="left" if heading == "method" else "right")
    for method, outcomes in results.items():
        cells = [_shares([o for o in outcomes if getattr(o, column) == value]) for value in values]
        median_px = np.median([o.error_px for o in outcomes])
        inliers = np.median([o.inliers for o in outcomes])
        milliseconds = 1000 * np.median([o.seconds for o in outcomes])
        sheet.add_row(method, *cells, _shares(outcomes), f"{median_px:.3f}", f"{inliers:.0f}", f"{milliseconds:.0f}")
    return sheet


def _shares(outcomes: list[Outcome]) -> str:
    errors = np.array([outcome.error_px for outcome in outcomes])
    shares = "/".join(f"{100 * np.mean(errors < limit):.0f}" for limit in LIMITS_PX)
    return f"{shares} {np.median(errors):.2f}px"


def unrelated_pairs(pairs: list[KnownPair]) -> list[tuple[Path, Path]]:
    """Pairs of photographs from two different flights, the same list on every run."""
    combinations = [(a.left, b.right) for a in pairs for b in pairs if a.flight != b.flight]
    return random.Random(0).sample(combinations, min(NEGATIVE_PAIRS, len(combinations)))


def wrongly_accepted(pairs: list[tuple[Path, Path]], refine: bool) -> list[tuple[Path, Path]]:
    """The unrelated pairs that were registered all the same."""
    method = ours(refine=refine)
    progress = track(pairs, description="unrelated pairs", console=Console(stderr=True), transient=True)
    return [pair for pair in progress if method(*pair)[0] is not None]


def rows(pairs: list[KnownPair], refine: bool, wanted: list[str] | None) -> dict[str, Method]:
    """The methods to run, by the name of their row; ``wanted`` are first words of it (None: all)."""
    own_count = round(np.median([len(register(p.left, p.right).features[0]) for p in pairs[::8]]))
    every = {"aerial": ours(), "fast": ours(detector="fast"), "thesis": ours(preset="thesis")}
    if refine:
        every["aerial --refine"] = ours(refine=True)
    every |= {f"{name} {count}": baseline(name, count) for name in BASELINES for count in (FEW_FEATURES, own_count)}
    names = dict.fromkeys(name.split()[0] for name in every)
    unknown = [name for name in wanted or () if name not in names]
    if unknown:
        raise typer.BadParameter(f"no method {', '.join(unknown)}; valid: {', '.join(names)}")
    return {name: run for name, run in every.items() if not wanted or name.split()[0] in wanted}


def main(
    data: Annotated[Path, typer.Option(help="Folder with pairs.csv.")],
    negatives: Annotated[bool, typer.Option("--negatives", help="Try unrelated pairs instead.")] = False,
    refine: Annotated[bool, typer.Option("--refine", help="Add our second, guided pass as a row.")] = False,
    method: Annotated[list[str] | None, typer.Option(help="Only these: aerial, thesis, fast, sift, ...")] = None,
    json_file: Annotated[Path | None, typer.Option("--json", help="Write every outcome here.")] = None,
) -> None:
    """Print the table of results."""
    cv2.setNumThreads(1)
    console = Console(width=160)
    pairs = read_pairs(data)
    if negatives:
        tried = unrelated_pairs(pairs)
        accepted = wrongly_accepted(tried, refine)
        console.print(f"{len(accepted)} of {len(tried)} unrelated pairs accepted {accepted or ''}")
        written: object = {"tried": tried, "accepted": accepted}
    else:
        chosen = rows(pairs, refine, method)
        results = {name: list(measure(run, pairs, name)) for name, run in chosen.items()}
        note = f"{len(pairs)} pairs; shares under {'/'.join(map(str, LIMITS_PX))} px in %, median px"
        console.print(table(f"by group: {note}", results, "group"))
        console.print(table(f"by flight: {note}", results, "flight"))
        written = {name: [dataclasses.asdict(outcome) for outcome in outcomes] for name, outcomes in results.items()}
    if json_file:
        json_file.write_text(json.dumps(written, indent=1, default=str) + "\n")


if __name__ == "__main__":
    typer.run(main)
