"""Public photographs by the names of their folders, and the folders of pairs with known homographies."""

import csv
import os
from collections.abc import Iterable
from pathlib import Path

from golden_model.arrays import Matrix, Pixels
from skymosaic.evaluation.known_pairs import COLUMNS, LIST_NAME
from skymosaic.imagery.images import save


def public_folder(name: str | Path) -> Path:
    """A folder by its path, or by its name among the public photographs that SKYMOSAIC_DATA names."""
    data = Path(os.environ.get("SKYMOSAIC_DATA", ""))
    for folder in (Path(name), data / name, data / "flights" / name):
        if folder.is_dir():
            return folder
    raise SystemExit(f"{name}: no such folder; set SKYMOSAIC_DATA to that of the public photographs, or name a path")


def write_set(folder: Path, pairs: Iterable[tuple[str, str, Pixels, Pixels, Matrix]]) -> None:
    """Write pairs (name, group, left, right, homography from left to right) as a folder that `read_pairs` reads."""
    (folder / "images").mkdir(parents=True, exist_ok=True)
    with (folder / LIST_NAME).open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(COLUMNS)
        for name, group, *images, truth in pairs:
            paths = [f"images/{name}_{side}.png" for side in ("left", "right")]
            for path, image in zip(paths, images, strict=True):
                save(folder / path, image)
            writer.writerow([name, group, *paths, *(truth / truth[2, 2]).ravel().tolist()])
