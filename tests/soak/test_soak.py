"""A slice of the endurance run; ``make test-soak`` is the whole."""

import pytest

from tests.soak.soak import soak


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2])
def test_every_frame_comes_once_and_equals_the_golden_model(seed: int) -> None:
    counts = soak(800_000, seed)
    assert "good frames" in counts
    assert "bad (" in counts
