"""Tries to register photographs of different flights, at every effort: none may be accepted.

    python bench/unrelated.py FLIGHT FLIGHT [...] [--pairs 1000] [--part 1/2] [--json FILE]

The list of pairs is the same on every run. For each pair the best support of any pass is written, accepted or not, so
that the limits of `skymosaic.geometry.acceptance` can be judged.
"""

from __future__ import annotations

import json
import random
from itertools import combinations
from pathlib import Path
from typing import Annotated

import cv2
import typer
from rich.console import Console
from rich.progress import track

from remembering import RememberingBackend
from skymosaic import register
from skymosaic.imagery.images import load, reduce_to_width
from skymosaic.imagery.photographs import list_sources
from skymosaic.registration.options import EFFORTS

WIDTH_PX = 640
FRAMES_A_PHOTOGRAPH = 12


def unrelated_pairs(flights: list[Path], count: int) -> list[tuple[Path, Path]]:
    """``count`` pairs of photographs from two flights each, the same on every run."""
    photographs = [[Path(str(source.content)) for source in list_sources([flight])] for flight in flights]
    pairs = [(one, other) for a, b in combinations(photographs, 2) for one in a for other in b]
    return random.Random(0).sample(pairs, min(count, len(pairs)))


def main(
    *,
    flights: Annotated[list[Path], typer.Argument(help="Folders of photographs, one for each flight.")],
    pairs: Annotated[int, typer.Option(min=1, help="Pairs to try.")] = 1000,
    part: Annotated[str, typer.Option(help="PART/PARTS: only every PARTS-th pair, from PART on.")] = "1/1",
    skip: Annotated[int, typer.Option(min=0, help="Leave out so many of them, for going on after a break.")] = 0,
    effort: Annotated[list[str] | None, typer.Option(help="Only these; by default all.")] = None,
    json_file: Annotated[Path | None, typer.Option("--json", help="Write every outcome here.")] = None,
) -> None:
    """Print how many were accepted."""
    cv2.setNumThreads(1)
    number, parts = map(int, part.split("/"))
    tried = unrelated_pairs(flights, pairs)[number - 1 :: parts][skip:]
    images = {
        path: reduce_to_width(load(path).pixels, WIDTH_PX)[0]
        for path in track(sorted({path for pair in tried for path in pair}), description="reading")
    }
    backend = RememberingBackend(frames=FRAMES_A_PHOTOGRAPH * len(images))
    outcomes = []
    for left, right in track(tried, description="unrelated pairs"):
        for level in effort or EFFORTS:
            pair = register(images[left], images[right], effort=level, backend=backend)
            names = [f"{path.parent.name}/{path.name}" for path in (left, right)]
            outcomes.append(
                {
                    "pair": names,
                    "effort": level,
                    "accepted": pair.accepted,
                    "inliers": len(pair.inliers),
                    "passes": pair.passes,
                    "reason": pair.reason,
                }
            )
            if pair.accepted:
                Console().print(f"accepted, {level}: {names}, {len(pair.inliers)} inliers")
        if json_file:
            json_file.write_text(json.dumps(outcomes, indent=1) + "\n")
    for level in effort or EFFORTS:
        chosen = [outcome for outcome in outcomes if outcome["effort"] == level]
        accepted = sum(outcome["accepted"] for outcome in chosen)
        print(f"{level}: {accepted} of {len(chosen)} accepted, most inliers {max(o['inliers'] for o in chosen)}")


if __name__ == "__main__":
    typer.run(main)
