"""Public photographs by the names of their folders, and sets of pairs with known homographies.

Sets are this project's list (`skymosaic.evaluation.known_pairs`), or have the layout of homography benchmarks:

- Oxford's affine set (Mikolajczyk and others, 2005): folders with ``img1.ppm`` ... ``img6.ppm``, ``H1to2p`` ...
- HPatches (Balntas and others, 2017): folders ``i_...`` and ``v_...`` with ``1.ppm`` ... ``6.ppm``, ``H_1_2`` ...
"""

import csv
import os
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from golden_model.arrays import Matrix, Pixels
from skymosaic.common.errors import InputError
from skymosaic.evaluation.known_pairs import COLUMNS, LIST_NAME, KnownPair, read_pairs
from skymosaic.imagery.images import save

IMAGES = range(2, 7)
STEMS = ("img{}", "{}")
MATRICES = ("H1to{}p", "H_1_{}")


def public_folder(name: str | Path) -> Path:
    """A folder by its path, or by its name among the public photographs that SKYMOSAIC_DATA names."""
    data = Path(os.environ.get("SKYMOSAIC_DATA", ""))
    for folder in (Path(name), data / name, data / "flights" / name):
        if folder.is_dir():
            return folder
    raise SystemExit(f"{name}: no such folder; set SKYMOSAIC_DATA to that of the public photographs, or name a path")


def read_set(folder: Path) -> list[KnownPair]:
    """The pairs of a folder with a pairs.csv, or of a folder of sequences.

    Raises
    ------
    InputError
        If it holds neither, or a matrix is not of nine numbers.
    """
    if (folder / LIST_NAME).is_file():
        return read_pairs(folder)
    pairs = [pair for sequence in (folder, *sorted(folder.glob("*/"))) for pair in _sequence_pairs(sequence)]
    if not pairs:
        raise InputError(f"{folder}: holds neither {LIST_NAME} nor folders with img1 ... img6 and H1to2p ... H1to6p")
    return pairs


def write_set(folder: Path, pairs: Iterable[tuple[str, str, Pixels, Pixels, Matrix]]) -> None:
    """Write pairs (name, group, left, right, homography from left to right) as a folder that `read_set` reads."""
    (folder / "images").mkdir(parents=True, exist_ok=True)
    with (folder / LIST_NAME).open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(COLUMNS)
        for name, group, *images, truth in pairs:
            paths = [f"images/{name}_{side}.png" for side in ("left", "right")]
            for path, image in zip(paths, images, strict=True):
                save(folder / path, image)
            writer.writerow([name, group, *paths, *(truth / truth[2, 2]).ravel().tolist()])


def _sequence_pairs(folder: Path) -> list[KnownPair]:
    """The first image with each other one that has a matrix; HPatches groups by kind, others by sequence."""
    first = _image(folder, 1)
    if first is None:
        return []
    group = {"i_": "illumination", "v_": "viewpoint"}.get(folder.name[:2], folder.name)
    pairs = []
    for number in IMAGES:
        image = _image(folder, number)
        matrix = next((path for name in MATRICES if (path := folder / name.format(number)).is_file()), None)
        if image and matrix:
            pairs.append(KnownPair(f"{folder.name}_1_{number}", group, first, image, _matrix(matrix)))
    return pairs


def _image(folder: Path, number: int) -> Path | None:
    candidates = (path for stem in STEMS for path in sorted(folder.glob(stem.format(number) + ".*")))
    return next(candidates, None)


def _matrix(path: Path) -> np.ndarray:
    try:
        return np.loadtxt(path).reshape(3, 3)
    except ValueError:
        raise InputError(f"{path}: must hold nine numbers, three in a line") from None
