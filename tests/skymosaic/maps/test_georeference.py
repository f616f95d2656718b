from typing import Any

import numpy as np
import pytest

from skymosaic.imagery.exif import Position
from skymosaic.maps.georeference import fit_to_map, map_to_globe, project_to_utm


@pytest.mark.parametrize(("crs", "false_north"), [("EPSG:32615", 5_190_000.0), ("EPSG:32733", 6_240_000.0)])
def test_a_turned_and_scaled_layout_is_found_on_the_map(crs: str, false_north: float) -> None:
    rng = np.random.default_rng(4)
    places = rng.uniform(0, 4000, (12, 2))
    turn = 0.05 * np.exp(0.6j)  # metres per pixel, and the turn of the flight
    complex_m = (places[:, 0] - 1j * places[:, 1]) * turn
    metres = np.column_stack([430_000 + complex_m.real, false_north + complex_m.imag])
    zone, same = project_to_utm([Position(lat, lon) for lon, lat in map_to_globe(metres, crs)])
    assert zone == crs
    np.testing.assert_allclose(same, metres, atol=2e-3)
    place, reason = fit_to_map(places, same, zone)
    assert reason == ""
    assert place.residual_m < 1e-3
    assert place.metres_per_pixel == pytest.approx(0.05, rel=1e-6)
    mapped = places @ place.to_map[:2, :2].T + place.to_map[:2, 2]
    np.testing.assert_allclose(mapped, metres, atol=2e-3)


def test_a_wrong_first_position_does_not_choose_the_zone() -> None:
    good = [Position(45 + 0.001 * i, 12 + 0.001 * (i % 3)) for i in range(12)]
    _, metres = project_to_utm(good)
    places = np.vstack([(500, 500), (metres - metres[0]) * [10, -10]])
    zone, targets = project_to_utm([Position(22.5, 113.9), *good])
    place, _ = fit_to_map(places, targets, zone)
    assert (zone, place.disagreeing) == ("EPSG:32633", (0,))
    assert place.metres_per_pixel == pytest.approx(0.1, rel=1e-6)


def scattered(count: int, noise_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Places on a mosaic of 5 cm per pixel, and the same on the map with noise."""
    rng = np.random.default_rng(5)
    places = rng.uniform(0, 4000, (count, 2))
    metres = [430_000, 5_190_000] + 0.05 * places * [1, -1]
    return places, metres + rng.normal(0, noise_m, (count, 2))


def test_the_residual_is_the_noise_of_the_positions() -> None:
    place, _ = fit_to_map(*scattered(400, 2.0), "EPSG:32615")
    assert place.residual_m == pytest.approx(2 * np.sqrt(2), rel=0.1)


def test_positions_that_are_far_off_are_named_and_do_not_count() -> None:
    places, metres = scattered(20, 0.5)
    metres[[3, 11, 12]] += [60, -40]
    place, _ = fit_to_map(places, metres, "EPSG:32615")
    assert place.disagreeing == (3, 11, 12)
    assert place.offsets_m[11] == pytest.approx(np.hypot(60, 40), abs=3)
    assert place.residual_m < 1.2
    assert place.metres_per_pixel == pytest.approx(0.05, rel=0.01)


NAN = (np.nan, np.nan)


@pytest.mark.parametrize("kind", ["strip", "anywhere", "hemisphere", "drift"])
@pytest.mark.parametrize("share", [0.1, 0.2, 0.3])
def test_positions_that_are_off_by_one_vector_are_named(kind: str, share: float) -> None:
    """They bend a fit to all until none stands out. The scale is right within what is said of it."""
    within = dropped = 0
    for seed in range(4):
        rng = np.random.default_rng(seed)
        places = 200.0 * np.stack(np.divmod(np.arange(30), 6), axis=1) + rng.normal(0, 5, (30, 2))
        noise_m = rng.normal(0, 0.1, (30, 2)) @ [1, 1j]
        complex_m = (places[:, 0] - 1j * places[:, 1]) * 0.042 * np.exp(2j * np.pi * rng.uniform()) + noise_m
        metres = np.column_stack([complex_m.real + 430_000, complex_m.imag + 5_190_000])
        wrong = np.arange(round(30 * share)) if kind in ("strip", "drift") else rng.permutation(30)[: round(30 * share)]
        offset = np.array([-1.4e6, 0] if kind == "hemisphere" else [4.2, 4.2])
        metres[wrong] += np.outer(np.linspace(1.5, 0.7, len(wrong)), offset) if kind == "drift" else offset
        place, reason = fit_to_map(places, metres, "EPSG:32615")
        assert place is not None, reason
        assert set(place.disagreeing) >= set(wrong.tolist())
        dropped += len(place.disagreeing) - len(wrong)
        error = abs(place.metres_per_pixel / 0.042 - 1)
        assert error < 0.005
        within += error < place.scale_error
    assert dropped <= 0.03 * 4 * (30 - len(wrong)) + 1
    assert within >= 3


@pytest.mark.parametrize(
    ("metres", "message"),
    [
        ([NAN, NAN, (0, 0), (0, 1000)], "2 of 4"),
        ([(5, 5)] * 4, "coincide"),
        ([(0, 0), (0, 1000), (0, 0), (0, 1000)], "do not fit|too much"),
        ([(0, 0), (0, 1000), (0, 0), (100, 0)], "too much"),
    ],
)
def test_positions_that_do_not_determine_the_map_are_refused(metres: list[Any], message: str) -> None:
    places = np.array([[0, 0], [0, 1000], [1000, 1000], [1000, 0]], dtype=np.float64)
    place, reason = fit_to_map(places, np.array(metres, dtype=np.float64), "EPSG:32615")
    assert place is None
    assert any(part in reason for part in message.split("|"))
