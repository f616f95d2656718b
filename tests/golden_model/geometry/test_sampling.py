"""Samples of different ranks, all alike, from the subsets that PROSAC's growth gives."""

import numpy as np
import pytest

from golden_model.geometry.sampling import STEPS, advance, draw, subset_size


@pytest.mark.parametrize("size", [4, 5, 40, 2048])
def test_ranks_are_different_and_equally_frequent(size: int) -> None:
    state, samples = 1, []
    for _ in range(4000):
        sample, state = draw(state, size)
        samples.append(sample)
    assert all(len(set(sample)) == 4 for sample in samples)
    counts = np.bincount(np.ravel(samples), minlength=size)
    assert len(counts) == size
    expected = 4 * 4000 / size
    # The variance of a count is below its mean; chi-squared over the ranks.
    assert ((counts - expected) ** 2 / expected).sum() < size + 5 * np.sqrt(2 * size)


def test_subsets_grow_to_all_matches() -> None:
    sizes = [subset_size(700, step) for step in range(STEPS)]
    assert sizes == sorted(sizes)
    assert sizes[-1] == 700
    assert sizes == [-(-700 * (step + 1) // STEPS) for step in range(STEPS)]
    assert [subset_size(4, step) for step in range(STEPS)] == [4] * STEPS


def test_the_generator_does_not_fall_into_a_short_cycle() -> None:
    state = 0x9E3779B9
    seen = {state}
    for _ in range(20_000):
        state = advance(state)
        seen.add(state)
    assert len(seen) == 20_001
    assert 0 not in seen
