"""Cuts pairs with a pseudo truth out of flights, for judging what was not tuned on them.

    python bench/flight_pairs.py DIR FLIGHT=COUNT [...] [--known FILE]

Photographs up to three apart in a flight are registered by SIFT at 1600 px with a loose tolerance and refitted to the
inliers. So the truth favours SIFT, keeps pairs that SIFT solves, and with relief is one of several planes: where ours
correlates better than the truth (docs/registration.md), the truth is the one that is off.
"""

from __future__ import annotations

import csv
import random
from pathlib import Path
from typing import Annotated

import cv2
import numpy as np
import typer
from rich.progress import track

from baselines import ManySift
from golden_model.arrays import Matrix, Pixels
from golden_model.pixel.gray import to_gray
from skymosaic.evaluation.known_pairs import COLUMNS, LIST_NAME
from skymosaic.geometry.acceptance import hull_area, overlap
from skymosaic.imagery.images import load, reduce_to_width, save
from skymosaic.imagery.photographs import list_sources

TRUTH_WIDTH_PX, WIDTH_PX = 1600, 640
SIFT_FEATURES = 6000
TOLERANCE_PX = 4.0
FEWEST_INLIERS, LEAST_SHARE = 60, 0.3
OVERLAPS = (0.15, 0.8)
FARTHEST = 3


def truth_of(left: Pixels, right: Pixels) -> Matrix | None:
    """The homography by RootSIFT and MAGSAC, fitted again to its inliers; None where it is doubtful."""
    left_points, right_points = ManySift(SIFT_FEATURES, root=True).match(left, right)
    if len(left_points) < FEWEST_INLIERS:
        return None
    found, mask = cv2.findHomography(
        left_points, right_points, cv2.USAC_MAGSAC, TOLERANCE_PX, maxIters=20_000, confidence=0.99999
    )
    if found is None or mask.sum() < FEWEST_INLIERS or mask.mean() < LEAST_SHARE:
        return None
    inliers = mask.ravel() > 0
    found, _ = cv2.findHomography(left_points[inliers], right_points[inliers], 0)
    size = left.shape[1], left.shape[0]
    share = hull_area(overlap(found, size, (right.shape[1], right.shape[0]))) / (size[0] * size[1])
    return found if OVERLAPS[0] <= share <= OVERLAPS[1] else None


def main(
    folder: Annotated[Path, typer.Argument(help="Where images and pairs.csv are written.")],
    flights: Annotated[list[str], typer.Argument(help="FOLDER=COUNT: how many pairs of which flight.")],
    known: Annotated[Path | None, typer.Option(help="pairs.csv whose pairs are left out, by name.")] = None,
) -> None:
    """Cut the pairs out and list them."""
    (folder / "images").mkdir(parents=True, exist_ok=True)
    taken = {row["name"] for row in csv.DictReader(known.open(newline=""))} if known else set()
    with (folder / LIST_NAME).open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(COLUMNS)
        for flight, count in (part.rsplit("=", 1) for part in flights):
            photographs = list_sources([flight])
            word = Path(flight).name.split("_")[0]
            steps = [(i, i + step) for step in range(1, FARTHEST + 1) for i in range(len(photographs) - step)]
            random.Random(5).shuffle(steps)
            found = 0
            for i, j in track(sorted(steps[: 3 * int(count)]), description=word):
                name = f"real_{word}_{i}_{j}"
                if found == int(count) or name in taken:
                    continue
                images = [
                    reduce_to_width(to_gray(load(photographs[k].content).pixels), TRUTH_WIDTH_PX)[0] for k in (i, j)
                ]
                truth = truth_of(images[0], images[1])
                if truth is None:
                    continue
                found += 1
                small, to_large = zip(*(reduce_to_width(image, WIDTH_PX) for image in images), strict=True)
                names = [f"images/{name}_{side}.png" for side in ("left", "right")]
                for path, image in zip(names, small, strict=True):
                    save(folder / path, image)
                matrix = np.linalg.inv(to_large[1]) @ truth @ to_large[0]
                writer.writerow([name, "unseen", *names, *(matrix / matrix[2, 2]).ravel().tolist()])


if __name__ == "__main__":
    typer.run(main)
