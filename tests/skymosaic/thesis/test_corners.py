import itertools

import numpy as np

from skymosaic.thesis.corners import CORNERS, compute_responses, detect_strongest, find_threshold, raise_threshold
from skymosaic.thesis.dataset import DatasetPair


def test_the_strongest_corners_are_those_above_their_threshold(pair: DatasetPair) -> None:
    gray = pair.grays[0]
    threshold, features = find_threshold(gray), detect_strongest(gray)
    assert len(features) == np.count_nonzero(compute_responses(gray) >= threshold)
    assert CORNERS <= len(features) < CORNERS + 5


def test_the_threshold_doubles_until_the_matches_are_good(pair: DatasetPair) -> None:
    easy, hard = (raise_threshold(pair.grays, target) for target in (0.0, 1.0))
    assert (len(easy), easy[0].threshold) == (1, 1 << 15)
    # The last has at least fifty corners in both, and the next one would not.
    assert len(hard) > 2
    assert min(map(len, hard[-1].features)) >= 50
    assert min(np.count_nonzero(compute_responses(gray) >= 2 * hard[-1].threshold) for gray in pair.grays) < 50
    assert all(later.threshold == 2 * earlier.threshold for earlier, later in itertools.pairwise(hard))
    assert all(one.quality < 1 for one in hard[:-1])
    corners = [len(one.features[0]) for one in hard]
    assert corners == sorted(corners, reverse=True)


def test_flat_images_have_no_threshold_to_raise_to() -> None:
    flat = np.full((160, 200), 90, np.uint8)
    assert len(raise_threshold((flat, flat))) == 1
    # With more corners than fit, a picture has none: the search begins where they fit.
    noise = np.random.default_rng(1).integers(0, 256, (480, 640), np.uint8)
    (first, *_) = raise_threshold((noise, flat))
    assert first.threshold > 1 << 12
    assert max(map(len, first.features)) > 0
    assert len(detect_strongest(flat)) == 0
