from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from bench.pair_sets import read_set
from skymosaic.common.errors import InputError

SHIFT = np.array([[1.0, 0, 5], [0, 1, -3], [0, 0, 1]])


def sequence(folder: Path, stem: str, matrix: str, numbers: tuple[Any, ...]) -> None:
    folder.mkdir()
    image = np.zeros((64, 64), np.uint8)
    for number in (1, *numbers):
        cv2.imwrite(str(folder / f"{stem.format(number)}.png"), image)
    for number in numbers:
        np.savetxt(folder / matrix.format(number), SHIFT)


def test_sequences_of_both_benchmarks_are_read(tmp_path: Path) -> None:
    sequence(tmp_path / "graffiti", "img{}", "H1to{}p", (2, 3))
    sequence(tmp_path / "v_wall", "{}", "H_1_{}", (2, 6))
    pairs = read_set(tmp_path)
    assert [(pair.name, pair.group) for pair in pairs] == [
        ("graffiti_1_2", "graffiti"),
        ("graffiti_1_3", "graffiti"),
        ("v_wall_1_2", "viewpoint"),
        ("v_wall_1_6", "viewpoint"),
    ]
    assert pairs[0].left.name == "img1.png"
    assert pairs[-1].right.name == "6.png"
    np.testing.assert_array_equal(pairs[0].truth, SHIFT)


def test_an_empty_folder_and_a_broken_matrix_are_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="neither"):
        read_set(tmp_path)
    sequence(tmp_path / "bark", "img{}", "H1to{}p", (2,))
    (tmp_path / "bark" / "H1to2p").write_text("1 2 3\n")
    with pytest.raises(InputError, match="nine numbers"):
        read_set(tmp_path)
