"""How often, and how closely, pairs with a known homography are registered, beside OpenCV's methods in one run.

    python -m bench.registration methods SET ...
    python -m bench.registration unrelated FLIGHT FLIGHT ...
    python -m bench.registration render DIR
    python -m bench.registration cut DIR FLIGHT=COUNT ...

A SET is a folder with a pairs.csv, or ``registration``, the public pairs below SKYMOSAIC_DATA; ``render`` and ``cut``
write such folders. The error of a pair is the mean distance over a 20x20 grid of left points that fall
inside the right image. The truth of `REAL` pairs is a plane through their relief; `bench.patches` asks the pictures.
"""

import random
import time
from dataclasses import dataclass
from itertools import chain, combinations
from pathlib import Path
from typing import Annotated

import cv2
import numpy as np
import typer
from rich.console import Console
from rich.progress import track

from bench import flight_pairs
from bench.flight_pairs import WRONG_PX
from bench.methods import ON_CHIP, REFERENCE, Method, chosen_methods, estimate_on_chip, read_gray
from bench.patches import confirmed_share
from bench.rendered_pairs import STEPS, flat_pairs, write_set
from bench.report import Flights, JsonFile, Row, program, public_folder, report
from golden_model.config import MIN_FRAME_PX
from skymosaic import extract, register
from skymosaic.evaluation.known_pairs import KnownPair, read_pairs
from skymosaic.evaluation.metrics import MISSING_ERROR_PX, grid_error
from skymosaic.imagery.images import load, reduce_to_width
from skymosaic.imagery.photographs import list_sources
from skymosaic.registration.options import EFFORTS, Effort

app = program(__doc__)
progress = Console(stderr=True)

LIMITS_PX = (1, 3, 5)
REAL = ("real", "unseen")
"""Groups of pairs with relief."""
Sets = Annotated[list[str], typer.Argument(help="Folders of pairs; several are joined.", metavar="SET...")]
Seeds = Annotated[int, typer.Option(min=1, help="Seeds of our estimator; OpenCV's are fixed.")]
Methods = Annotated[list[str] | None, typer.Option(help="Only these: normal, thorough, sift, ...")]


@dataclass(frozen=True)
class Outcome:
    """What a method made of one pair: an error for each seed, and the processor time of the first."""

    group: str
    error_px: tuple[float, ...]
    seconds: float
    confirmed: tuple[float | None, ...]
    """For each seed, the share of the patches that lie within 2 px; of `REAL` pairs."""


@app.command()
def methods(
    *,
    sets: Sets,
    seeds: Seeds = 5,
    method: Methods = None,
    by_group: Annotated[bool, typer.Option("--by-group", help="A row for each group of pairs.")] = False,
    json_file: JsonFile = None,
) -> None:
    """Accuracy and processor time of each method.

    A share is the mean over the seeds; where it differs between seeds, lowest and highest follow. mAA is the mean of
    the shares under 1, 2, ... 10 px. Patches: how many of those of real pairs lie within 2 px, the mean over pairs and
    seeds; none of a pair that is refused. Wrong: accepted and more than 20 px off, at any seed. The time is a ratio to
    SIFT's, pair by pair, in the median.
    """
    cv2.setNumThreads(1)
    pairs = [pair for name in sets for pair in read_pairs(public_folder(name))]
    chosen = chosen_methods(method)
    results: dict[str, list[Outcome]] = {heading: [] for heading in chosen}
    for pair in track(pairs, description="pairs", console=progress, transient=True):
        # Side by side, so that a busy machine slows all methods alike.
        for heading, run in chosen.items():
            results[heading].append(measure(run, pair, seeds))
    rows = group_rows(results) if by_group else [method_row(results, heading) for heading in results]
    report(f"{len(pairs)} pairs, {seeds} seeds; under {'/'.join(map(str, LIMITS_PX))} px in %", rows, json_file)


def measure(method: Method, pair: KnownPair, seeds: int) -> Outcome:
    """Run a method on a pair."""
    images = read_gray(pair.left), read_gray(pair.right)
    errors, confirmed = list[float](), list[float | None]()
    seconds = 0.0
    start = time.process_time()
    for homography in method(pair, seeds):
        if not errors:
            seconds = time.process_time() - start
        error = min(grid_error(homography, pair.truth, *(each.shape[::-1] for each in images)), MISSING_ERROR_PX - 1)
        errors.append(error if homography is not None else MISSING_ERROR_PX)
        if pair.group in REAL:
            confirmed.append(confirmed_share(*images, homography, pair.truth))
    return Outcome(pair.group, tuple(errors), seconds, tuple(confirmed))


def method_row(results: dict[str, list[Outcome]], heading: str) -> Row:
    """A method's shares by group and over all pairs, what it refused or had wrong, and its time."""
    outcomes = results[heading]
    errors = np.array([outcome.error_px for outcome in outcomes])
    refused = float((errors == MISSING_ERROR_PX).sum(axis=0).mean())
    return {
        "method": heading,
        **{group: shares([o for o in outcomes if o.group == group]) for group in sorted({o.group for o in outcomes})},
        "all pairs": shares(outcomes),
        "patches": share_of_patches(outcomes),
        "mAA": round(100 * float(np.mean([np.mean(errors < limit) for limit in range(1, 11)])), 1),
        "median": f"{np.median(errors):.2f} px" if refused < len(outcomes) / 2 else "most refused",
        "refused": round(refused, 1),
        "wrong": count_wrong(outcomes),
        "time": median_time(outcomes, results.get(REFERENCE)),
    }


def group_rows(results: dict[str, list[Outcome]]) -> list[Row]:
    """A row for each group of pairs: shares and median error of each method; what the first had wrong, and its time."""
    rows: list[Row] = []
    for group in sorted({outcome.group for outcomes in results.values() for outcome in outcomes}):
        chosen = {heading: [o for o in outcomes if o.group == group] for heading, outcomes in results.items()}
        medians = {heading: np.median([o.error_px for o in outcomes]) for heading, outcomes in chosen.items()}
        cells = {
            heading: f"{shares(chosen[heading])}, {median:.2f} px" if median < MISSING_ERROR_PX else "refused"
            for heading, median in medians.items()
        }
        first = next(iter(chosen.values()))
        figures: Row = {"wrong": count_wrong(first), "time": median_time(first, chosen.get(REFERENCE))}
        rows.append({"pairs": group.replace("_", " "), **cells, **figures})
    return rows


def count_wrong(outcomes: list[Outcome]) -> int:
    """Pairs that are accepted and more than 20 px off, at any seed."""
    return sum(any(WRONG_PX < error < MISSING_ERROR_PX for error in outcome.error_px) for outcome in outcomes)


def share_of_patches(outcomes: list[Outcome]) -> str:
    """Percent of the patches of real pairs that are where they were found."""
    found = [share for outcome in outcomes for share in outcome.confirmed if share is not None]
    return f"{100 * np.mean(found):.1f} %" if found else ""


def median_time(outcomes: list[Outcome], reference: list[Outcome] | None) -> str:
    """A method's processor time for a pair: as a ratio to the reference's where that was measured too."""
    seconds = np.array([outcome.seconds for outcome in outcomes])
    if reference is None:
        return f"{1000 * np.median(seconds):.0f} ms"
    return f"{np.median(seconds / [outcome.seconds for outcome in reference]):.2f}"


def shares(outcomes: list[Outcome]) -> str:
    """Percent of pairs under each limit: mean over the seeds, and the range where they differ."""
    errors = np.array([outcome.error_px for outcome in outcomes])
    by_seed = (100 * np.mean(errors < limit, axis=0) for limit in LIMITS_PX)
    return " / ".join(
        f"{share.mean():.0f}" + (f" ({share.min():.0f}-{share.max():.0f})" if np.ptp(share) > 0 else "")
        for share in by_seed
    )


@app.command()
def unrelated(
    flights: Flights,
    pairs: Annotated[int, typer.Option(min=1, help="Pairs to try.")] = 1000,
    width_px: Annotated[int, typer.Option("--width", min=MIN_FRAME_PX, help="Photographs are reduced to it.")] = 640,
    effort: Annotated[list[str] | None, typer.Option(help="Only these; by default all.")] = None,
    on_chip: Annotated[bool, typer.Option("--on-chip", help="The estimator of the hardware instead.")] = False,
) -> None:
    """Try to register photographs of different flights, the same pairs on every run: none may be accepted.

    The inliers are those of the passes that are searched together; single passes are judged, but not counted.
    """
    cv2.setNumThreads(1)
    photographs = [[source.content for source in list_sources([public_folder(flight)])] for flight in flights]
    every = [(one, other) for a, b in combinations(photographs, 2) for one in a for other in b]
    tried = random.Random(0).sample(every, min(pairs, len(every)))
    features = {path: extract(reduce_to_width(load(path).pixels, width_px)[0]) for path in set(chain(*tried))}
    levels: list[Effort | None] = [None] if on_chip else [level for level in EFFORTS if level in (effort or EFFORTS)]
    rows: list[Row] = [
        {"effort": level or ON_CHIP, "pairs": len(tried), "accepted": 0, "most inliers": 0} for level in levels
    ]
    for left, right in track(tried, description="unrelated pairs", console=progress):
        for level, row in zip(levels, rows, strict=True):
            if level is None:
                (result,) = estimate_on_chip(features[left].photograph.pixels, features[right].photograph.pixels)
                count, is_accepted = result.inliers, result.causes == 0
            else:
                pair = register(features[left], features[right], effort=level)
                count, is_accepted = len(pair.inliers), pair.accepted
            row["accepted"] = int(row["accepted"]) + is_accepted
            row["most inliers"] = max(int(row["most inliers"]), count)
            if is_accepted:
                progress.print(f"accepted, {row['effort']}: {left}, {right}, {count} inliers")
    report("photographs of different flights", rows)


@app.command()
def render(
    folder: Annotated[Path, typer.Argument(help="Where images and pairs.csv are written.")],
    each: Annotated[int, typer.Option(min=1, help="Pairs for every step of a kind.")] = 8,
    kind: Annotated[list[str] | None, typer.Option(help="zoom, tilt, horizon, overlap, small, dark.")] = None,
) -> None:
    """Render hard pairs of flat ground, whose homographies are exact; by default of all kinds."""
    write_set(folder, chain.from_iterable(flat_pairs(one, each) for one in kind or STEPS))


@app.command()
def cut(
    folder: Annotated[Path, typer.Argument(help="Where images and pairs.csv are written.")],
    flights: Annotated[list[str], typer.Argument(help="FLIGHT=COUNT: how many pairs of which flight.")],
    known: Annotated[str | None, typer.Option(help="Set whose pairs are left out, by name.")] = None,
) -> None:
    """Cut pairs with a pseudo truth by SIFT out of flights, to judge what was not tuned on them."""
    names = {pair.name for pair in read_pairs(public_folder(known))} if known else set()
    counts = (flight.rsplit("=", 1) for flight in flights)
    write_set(
        folder, (pair for name, count in counts for pair in flight_pairs.cut(public_folder(name), int(count), names))
    )


if __name__ == "__main__":
    app()
