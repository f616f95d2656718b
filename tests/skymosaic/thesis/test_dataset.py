import dataclasses
from pathlib import Path

import numpy as np
import pytest

from bench.rendered_pairs import write_set
from skymosaic.common.errors import InputError
from skymosaic.thesis.dataset import DatasetPair, list_sources


def test_photographs_are_reduced_and_their_truth_with_them(tmp_path: Path, pair: DatasetPair) -> None:
    grow = np.array([[2, 0, 0.5], [0, 2, 0.5], [0, 0, 1]])
    left, right = (np.repeat(np.repeat(image, 2, axis=0), 2, axis=1) for image in (pair.left, pair.right))
    write_set(tmp_path, [("big", "real", left, right, grow @ pair.truth @ np.linalg.inv(grow))])
    (source,) = list_sources(tmp_path)
    read = source()
    assert read.sizes == pair.sizes
    np.testing.assert_array_equal(read.left, pair.left)
    np.testing.assert_allclose(read.truth, pair.truth, atol=1e-9)


def test_a_homography_without_overlap_is_named(pair: DatasetPair) -> None:
    away = np.array([[1.0, 0, 5000], [0, 1, 0], [0, 0, 1]])
    with pytest.raises(InputError, match="do not overlap"):
        dataclasses.replace(pair, truth=away)
