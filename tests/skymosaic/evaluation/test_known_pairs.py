from pathlib import Path

import numpy as np
import pytest

from skymosaic.common.errors import InputError
from skymosaic.evaluation.known_pairs import COLUMNS, read_pairs

HEADER = ",".join(COLUMNS)
LINE = "real_copr_0_1,real,a.jpg,b.jpg,1,0,5,0,1,-3,0,0,1"


def test_a_pair_is_read_with_its_files_and_homography(tmp_path: Path) -> None:
    (tmp_path / "pairs.csv").write_text(f"{HEADER}\n{LINE}\n")
    (pair,) = read_pairs(tmp_path)
    assert (pair.name, pair.group) == ("real_copr_0_1", "real")
    assert (pair.left, pair.right) == (tmp_path / "a.jpg", tmp_path / "b.jpg")
    np.testing.assert_array_equal(pair.truth, [[1, 0, 5], [0, 1, -3], [0, 0, 1]])


@pytest.mark.parametrize(("text", "words"), [
    (HEADER.replace("h11", "x"), "lacks h11"),
    (HEADER, "lists no pair"),
    (f"{HEADER}\n{LINE.replace(',5,', ',five,')}", "line 2: h00 to h22 must be nine numbers"),
    (f"{HEADER}\n{LINE.removesuffix(',1')}", "line 2: h00 to h22 must be nine numbers"),
])  # fmt: skip
def test_a_wrong_list_is_named(tmp_path: Path, text: str, words: str) -> None:
    (tmp_path / "pairs.csv").write_text(text + "\n")
    with pytest.raises(InputError, match=words):
        read_pairs(tmp_path)


def test_a_missing_list_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"pairs\.csv: cannot be read"):
        read_pairs(tmp_path)
