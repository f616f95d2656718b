"""What a grid of residuals gains over the homography, without a truth: held-out matches and correlation of the overlap.

    python bench/mesh.py --data DIR [--data DIR ...] [--effort thorough] [--json FILE]

For each accepted pair: the share of held-out matches within 2 px (of those within 12 px), and the correlation of the
high-passed overlap, by the homography alone and with `skymosaic.compositing.mesh`.
"""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import Annotated

import cv2
import numpy as np
import typer
from rich.console import Console
from rich.progress import track
from rich.table import Table

from known_sets import read_set
from skymosaic import register
from skymosaic.compositing.mesh import fit_mesh, fit_useful_mesh, held_out_shares
from skymosaic.features.positions import match_points
from skymosaic.registration.confidence import correlate_overlap

RELIEF_SHARE = 0.85
"""Pairs with fewer held-out matches within 2 px of the homography are counted as ones with relief."""


@dataclasses.dataclass(frozen=True)
class Outcome:
    """Share of held-out matches and correlation, without and with the grid; whether ``auto`` takes it."""

    pair: str
    shares: tuple[float, float]
    correlations: tuple[float, float]
    taken: bool


def main(
    data: Annotated[list[Path], typer.Option(help="Folder with pairs.csv, or of sequences; several are joined.")],
    effort: Annotated[str, typer.Option(help="fast, normal or thorough: more matches shape a better grid.")] = "normal",
    json_file: Annotated[Path | None, typer.Option("--json", help="Write every outcome here.")] = None,
) -> None:
    """Print the means over flat pairs and over those with relief."""
    cv2.setNumThreads(1)
    outcomes = []
    for known in track([pair for folder in data for pair in read_set(folder)], description="pairs"):
        pair = register(known.left, known.right, effort=effort)
        if pair.working_homography is None:
            continue
        left, right = pair.working
        given = pair.working_homography, *match_points(pair.kept), (left.shape[1], left.shape[0])
        mesh = fit_mesh(*given)
        shares = held_out_shares(*given)
        if mesh is None or shares == (0.0, 0.0):
            continue
        correlations = tuple(correlate_overlap((image, right), given[0]) for image in (left, mesh.bend(left)))
        outcomes.append(Outcome(known.name, shares, correlations, fit_useful_mesh(*given) is not None))
    console = Console(width=110)
    sheet = Table("pairs", "count", "held-out share", "with grid", "correlation", "with grid", "auto takes it")
    for name, relief in (("relief", True), ("flat", False)):
        chosen = [outcome for outcome in outcomes if (outcome.shares[0] < RELIEF_SHARE) == relief]
        if chosen:
            means = np.mean([(*outcome.shares, *outcome.correlations) for outcome in chosen], axis=0)
            taken = sum(outcome.taken for outcome in chosen)
            sheet.add_row(name, str(len(chosen)), *(f"{mean:.3f}" for mean in means), str(taken))
    console.print(sheet)
    if json_file:
        json_file.write_text(json.dumps([dataclasses.asdict(outcome) for outcome in outcomes], indent=1) + "\n")


if __name__ == "__main__":
    typer.run(main)
