import dataclasses
from pathlib import Path

import cv2
import numpy as np
import pytest

from skymosaic.common.errors import InputError
from skymosaic.evaluation.known_pairs import COLUMNS
from skymosaic.thesis.dataset import DatasetPair, list_sources


def test_photographs_are_reduced_and_their_truth_with_them(tmp_path: Path, pair: DatasetPair) -> None:
    grow = np.array([[2, 0, 0.5], [0, 2, 0.5], [0, 0, 1]])
    for side, image in (("left", pair.left), ("right", pair.right)):
        cv2.imwrite(str(tmp_path / f"{side}.png"), np.repeat(np.repeat(image, 2, axis=0), 2, axis=1))
    truth = grow @ pair.truth @ np.linalg.inv(grow)
    values = ",".join(map(repr, (truth / truth[2, 2]).ravel().tolist()))
    (tmp_path / "pairs.csv").write_text(f"{','.join(COLUMNS)}\nbig,real,left.png,right.png,{values}\n")
    (source,) = list_sources(tmp_path)
    read = source()
    assert read.sizes == pair.sizes
    np.testing.assert_array_equal(read.left, pair.left)
    np.testing.assert_allclose(read.truth, pair.truth, atol=1e-9)


def test_a_homography_without_overlap_is_named(pair: DatasetPair) -> None:
    away = np.array([[1.0, 0, 5000], [0, 1, 0], [0, 0, 1]])
    with pytest.raises(InputError, match="do not overlap"):
        dataclasses.replace(pair, truth=away)
