"""Reads pairs with known homographies: this project's list, or the layout that homography benchmarks share.

Oxford affine set (Mikolajczyk and others, 2005): folders with ``img1.ppm`` ... ``img6.ppm`` and ``H1to2p`` ...
HPatches (Balntas and others, 2017): folders ``i_...`` and ``v_...`` with ``1.ppm`` ... ``6.ppm`` and ``H_1_2`` ...
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from skymosaic.errors import InputError
from skymosaic.evaluation.known_pairs import LIST_NAME, KnownPair, read_pairs

IMAGES = range(2, 7)
STEMS = ("img{}", "{}")
MATRICES = ("H1to{}p", "H_1_{}")


def read_set(folder: Path) -> list[KnownPair]:
    """The pairs of a folder with a pairs.csv, or of a folder of sequences.

    Raises
    ------
    InputError
        If it holds neither, or a matrix is not of nine numbers.
    """
    if (folder / LIST_NAME).is_file():
        return read_pairs(folder)
    pairs = [pair for sequence in (folder, *sorted(folder.glob("*/"))) for pair in _of_sequence(sequence)]
    if not pairs:
        raise InputError(f"{folder}: holds neither {LIST_NAME} nor folders with img1 ... img6 and H1to2p ... H1to6p")
    return pairs


def _of_sequence(folder: Path) -> list[KnownPair]:
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
