import numpy as np
import pytest
from numpy.typing import NDArray

from skymosaic.features.contrast import even_contrast, find_pattern, find_shared, share_pattern

SIZE = (120, 160)


@pytest.fixture
def pattern() -> NDArray[np.float64]:
    return np.random.default_rng(0).normal(0, 6, SIZE)


def see(pattern: NDArray[np.float64], place: int) -> NDArray[np.uint8]:
    """Soft ground of a place under a pattern."""
    rows, columns = np.indices(SIZE) / 15
    return np.rint(120 + 20 * np.sin(rows + place) * np.cos(columns * (1 + place / 9)) + pattern).astype(np.uint8)


def test_the_pattern_is_what_images_of_different_places_share(pattern: NDArray[np.float64]) -> None:
    images = [see(pattern, place) for place in range(8)]
    found = find_pattern(images)
    assert np.corrcoef(found.ravel(), pattern.ravel())[0, 1] > 0.95
    # It has nothing of the ground.
    assert abs(np.corrcoef(found.ravel(), see(0 * pattern, 3).ravel())[0, 1]) < 0.1
    assert np.corrcoef((images[3] - found).ravel(), see(0 * pattern, 3).ravel())[0, 1] > 0.98


def test_images_share_a_pattern_at_the_same_pixels_only(pattern: NDArray[np.float64]) -> None:
    assert share_pattern(see(pattern, 1), see(pattern, 2))
    assert not share_pattern(see(pattern, 1), see(np.roll(pattern, 3, axis=1), 2))
    assert not share_pattern(see(pattern, 1), see(pattern, 2)[:-8])
    # The upper half shares it, which the first quarter alone would not tell from the whole.
    upper = np.where(np.arange(SIZE[0])[:, None] < SIZE[0] // 2, pattern, np.roll(pattern, 3, axis=1))
    assert not share_pattern(see(pattern, 1), see(upper, 2))
    assert not share_pattern(see(pattern, 1)[::-1], see(upper, 2)[::-1])


def test_a_display_is_where_images_are_alike(pattern: NDArray[np.float64]) -> None:
    rng = np.random.default_rng(2)
    left, right = (rng.integers(0, 256, SIZE, np.uint8) for _ in range(2))
    left[60:100, 20:140] = right[60:100, 20:140] = see(4 * pattern, 1)[60:100, 20:140]
    shared = find_shared(left, right)
    assert shared[60:100, 20:140].all()
    # The margin is half of the square that is compared, and half of one more.
    assert not shared[:38].any()


def test_contrast_is_even_without_light_and_pattern(pattern: NDArray[np.float64]) -> None:
    rng = np.random.default_rng(1)
    texture, light = rng.normal(0, 1, SIZE), np.linspace(70, 150, SIZE[1])
    dim = np.rint(light + pattern + texture * np.linspace(2, 10, SIZE[1])).clip(0, 255).astype(np.uint8)
    even = even_contrast(dim, pattern.astype(np.float32)).astype(np.float64)
    quarters = [even[:, start : start + 40] for start in range(0, SIZE[1], 40)]
    assert [quarter.mean() for quarter in quarters] == pytest.approx([128] * 4, abs=12)
    assert max(quarter.std() for quarter in quarters) < 1.6 * min(quarter.std() for quarter in quarters)
    assert np.corrcoef(even.ravel(), texture.ravel())[0, 1] > 0.9
    assert np.corrcoef(even_contrast(dim).astype(float).ravel(), texture.ravel())[0, 1] < 0.85
    # No direction of the image is special.
    np.testing.assert_allclose(even_contrast(dim.T).astype(int), even_contrast(dim).T.astype(int), atol=1)
