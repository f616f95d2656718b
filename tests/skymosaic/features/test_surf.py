import cv2
import numpy as np
import pytest

from skymosaic.features import surf


def box_filters(size_px: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Dxx, Dyy and Dxy drawn pixel by pixel, as figure 2 of the SURF paper shows them for 9x9."""
    lobe, half = size_px // 3, size_px // 2
    dyy, dxy = np.zeros((2, size_px, size_px))
    for third, value in enumerate((1, -2, 1)):
        dyy[third * lobe : (third + 1) * lobe, half - lobe + 1 : half + lobe] = value
    for rows, vertical in ((slice(half - lobe, half), 1), (slice(half + 1, half + 1 + lobe), -1)):
        for columns, horizontal in ((slice(half - lobe, half), 1), (slice(half + 1, half + 1 + lobe), -1)):
            dxy[rows, columns] = vertical * horizontal
    return dyy.T, dyy, dxy


def blob(radius_px: float, centre: tuple[float, float], side_px: int = 240) -> np.ndarray:
    y, x = np.indices((side_px, side_px))
    distance = np.hypot(x - centre[0], y - centre[1])
    return np.clip(255 * np.exp(-(distance**2) / (2 * radius_px**2)), 0, 255).astype(np.uint8)


@pytest.mark.parametrize("size_px", [9, 15, 27, 51])
def test_determinant_is_that_of_the_drawn_filters(size_px: int) -> None:
    gray = np.random.default_rng(size_px).integers(0, 256, (120, 131), dtype=np.uint8)
    dxx, dyy, dxy = (cv2.filter2D(gray.astype(np.float64), -1, kernel) / size_px**2 for kernel in box_filters(size_px))
    inner = (slice(size_px // 2, -(size_px // 2)),) * 2
    values = surf.determinant(cv2.integral(gray), size_px)
    np.testing.assert_allclose(values[inner], (dxx * dyy - (0.9 * dxy) ** 2)[inner], atol=1e-6)
    border = np.ones_like(values, dtype=bool)
    border[inner] = False
    assert not values[border].any()


def test_a_blob_is_found_at_its_place() -> None:
    centre = (118.3, 121.6)
    strongest = max(surf.key_points(blob(6, centre)), key=lambda point: point.response)
    np.testing.assert_allclose(strongest.pt, centre, atol=0.3)


def test_a_blob_has_the_scale_of_its_size_also_between_the_filters() -> None:
    small, large = (
        max(surf.key_points(blob(radius, (120, 120))), key=lambda point: point.response).size for radius in (4, 8)
    )
    assert 1.7 < large / small < 2.3
    # Their sizes differ by 6 and 12 px.
    radii = np.arange(5, 8.6, 0.5)
    sizes = [max(surf.key_points(blob(each, (120, 120))), key=lambda point: point.response).size for each in radii]
    np.testing.assert_allclose(sizes / radii, 5.4, rtol=0.06)


def test_nothing_in_a_flat_image_nor_in_one_smaller_than_the_filters() -> None:
    assert surf.key_points(np.full((128, 128), 77, np.uint8)) == []
    assert surf.key_points(np.zeros((20, 20), np.uint8)) == []
