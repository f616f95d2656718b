import re
from typing import Any

import numpy as np
import pytest

from skymosaic.imagery.exif import Position
from skymosaic.maps.georeference import MAX_TRIALS, Georeference, fit_to_map, map_to_globe, project_to_utm


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


def test_one_wrong_position_chooses_no_zone_and_one_off_the_map_is_far_off() -> None:
    good = [Position(45 + 0.001 * i, 12 + 0.001 * (i % 3)) for i in range(12)]
    _, metres = project_to_utm(good)
    places = np.vstack([(500, 500), (metres - metres[0]) * [10, -10]])
    zone, targets = project_to_utm([Position(22.5, 113.9), *good])
    place, _ = fit_to_map(places, targets, zone)
    assert (zone, place.disagreeing) == ("EPSG:32633", (0,))
    assert place.metres_per_pixel == pytest.approx(0.1, rel=1e-6)
    # At the equator, the map of a zone ends before a quarter of the globe; a sign or a zero is enough.
    zone, targets = project_to_utm([Position(0.0, -78.0), *good])
    np.testing.assert_array_equal(targets[1:], metres)
    place, _ = fit_to_map(places, targets, zone)
    assert place.disagreeing == (0,)
    assert 5e6 < place.offsets_m[0] < 2e7


@pytest.mark.parametrize(
    ("latitude_deg", "longitude_deg", "zone"),
    [(0, -180, 32601), (1, 180, 32601), (-0.1, 179.9, 32760), (45, 5.99, 32631), (45, 6, 32632), (-45, -0.1, 32730)],
)
def test_the_zone_of_a_place_is_known(latitude_deg: float, longitude_deg: float, zone: int) -> None:
    assert project_to_utm([Position(latitude_deg, longitude_deg)])[0] == f"EPSG:{zone}"


def scattered(count: int, noise_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Places on a mosaic of 5 cm per pixel, and the same on the map with noise."""
    rng = np.random.default_rng(5)
    places = rng.uniform(0, 4000, (count, 2))
    metres = [430_000, 5_190_000] + 0.05 * places * [1, -1]
    return places, metres + rng.normal(0, noise_m, (count, 2))


@pytest.mark.parametrize("count", [20, 60])
def test_positions_that_are_far_off_are_named_and_do_not_count(count: int) -> None:
    """Some are unknown; above 32, pairs are drawn by lot."""
    assert (count * (count - 1) // 2 > MAX_TRIALS) == (count == 60)
    places, metres = scattered(count, 0.5)
    wrong = [3, 11, 12, *range(40, count, 3)]
    metres[wrong] += [60, -40]
    metres[[0, 7, 12]] = np.nan
    place, _ = fit_to_map(places, metres, "EPSG:32615")
    assert place.disagreeing == tuple(each for each in wrong if each != 12)
    assert np.flatnonzero(np.isnan(place.offsets_m)).tolist() == [0, 7, 12]
    assert place.offsets_m[11] == pytest.approx(np.hypot(60, 40), abs=3)
    assert place.residual_m < 1.2
    assert place.residual_of_all_m == pytest.approx(np.hypot(60, 40) * np.sqrt((len(wrong) - 1) / (count - 3)), rel=0.1)
    assert place.metres_per_pixel == pytest.approx(0.05, rel=0.01)
    assert 0 < place.scale_error < 0.02


@pytest.mark.parametrize(("count", "limit"), [(12, 4.5), (102, 3.15)])
def test_of_few_positions_one_disagrees_only_farther_off(count: int, limit: float) -> None:
    angles = np.linspace(0, 2 * np.pi, count, endpoint=False)
    places = 2000 + 2000 * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    for offset, disagreeing in ((0.8 * limit, ()), (1.3 * limit, (5,))):
        metres = [430_000, 5_190_000] + 0.05 * places * [1, -1] + np.stack([np.cos(5 * angles), np.sin(5 * angles)], 1)
        metres[5] += (offset - 1) * np.array([np.cos(5 * angles[5]), np.sin(5 * angles[5])])
        assert fit_to_map(places, metres, "EPSG:32615")[0].disagreeing == disagreeing


@pytest.mark.parametrize(("count", "quantile"), [(2, np.nan), (3, 4.302653), (5, 2.446912)])
def test_the_scale_is_as_exact_as_the_positions_that_are_left(count: int, quantile: float) -> None:
    """By Student's distribution, of which these are the quantiles of 2 and of 6 degrees of freedom."""
    places, metres = scattered(count, 1.0)
    place, _ = fit_to_map(places, metres, "EPSG:32615", in_time=False)
    assert place is not None
    assert not place.disagreeing
    spread = place.metres_per_pixel * np.sqrt(((places - places.mean(axis=0)) ** 2).sum(axis=1).mean())
    expected = quantile * place.residual_m / spread / np.sqrt(2 * count - 4) if count > 2 else np.nan
    assert place.scale_error == pytest.approx(expected, rel=1e-4, nan_ok=True)


@pytest.mark.parametrize(("known", "count", "fewest"), [(0, 1, 2), (1, 2, 2), (2, 3, 3), (2, 9, 3)])
def test_too_few_positions_are_counted(known: int, count: int, fewest: int) -> None:
    places, metres = scattered(count, 0.1)
    metres[known:] = np.nan
    says = f"{known} of {count} photographs have GPS; {fewest} are needed"
    assert fit_to_map(places, metres, "EPSG:32615") == (None, says)


@pytest.mark.parametrize("degrees", [0, 1e-10, 1e-4, 30, 90, 150, 180, -30])
def test_other_pixels_keep_the_turn_of_the_map(degrees: float) -> None:
    cos, sin = 0.05 * np.cos(np.radians(degrees)), 0.05 * np.sin(np.radians(degrees))
    place = Georeference("EPSG:32615", np.array([[cos, sin, 4e5], [sin, -cos, 5e6], [0, 0, 1]]), 0.1)
    reduced = place.for_pixels(np.array([[4.0, 0, 1.5], [0, 4, 1.5], [0, 0, 1]]))
    corner = np.array([30.0, 20, 1])
    np.testing.assert_allclose(reduced.to_map @ corner, place.to_map @ (4 * corner + [1.5, 1.5, -3]), atol=1e-9)
    assert reduced.metres_per_pixel == pytest.approx(0.2)
    # Rounding errors turn no map with north up.
    assert (reduced.to_map[0, 1] == reduced.to_map[1, 0] == 0) == (abs(degrees) < 1e-9)


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
    assert dropped <= 0.03 * 4 * (30 - len(wrong))
    assert within >= 3


@pytest.mark.parametrize(
    ("metres", "message"),
    [
        ([*[(np.nan, 0)] * 2, (0, 0), (0, 1000)], "2 of 4"),
        ([(5, 5)] * 4, "coincide"),
        ([(0, 0), (0, 1000), (0, 0), (0, 1000)], "do not fit|too much"),
        ([(0, 0), (0, 1000), (0, 0), (100, 0)], "too much"),
        ([(0, 0), (0, 1000), (1000, 1000), (1000, 0)], "mirrored, they fit: check"),
    ],
)
def test_positions_that_do_not_determine_the_map_are_refused(metres: list[Any], message: str) -> None:
    places = np.array([[0, 0], [0, 1000], [1000, 1000], [1000, 0]], dtype=np.float64)
    place, reason = fit_to_map(places, np.array(metres, dtype=np.float64), "EPSG:32615")
    assert place is None
    assert any(part in reason for part in message.split("|"))


@pytest.mark.parametrize(("count", "flat"), [(4, 1.0), (20, 0.1)])
def test_positions_that_fit_far_better_mirrored_are_refused(count: int, flat: float) -> None:
    """Axes swapped, or a sign missing; where GPS is not exact enough to tell, a strip is right either way."""
    places, metres = (each * [1, flat] for each in scattered(count, 0.02))
    assert "; mirrored, they fit: check the signs" in fit_to_map(places, metres[:, ::-1], "EPSG:32615")[1]
    for right in (metres, metres + np.random.default_rng(0).normal(0, 3, metres.shape)):
        assert fit_to_map(places, right, "EPSG:32615")[0] is not None


def test_of_too_many_that_are_off_the_worst_are_named_first() -> None:
    places, metres = scattered(12, 0.1)
    metres[0] = np.nan
    for index, off_m in {2: (0, 150), 5: (-300, 0), 6: (0, -250), 9: (200, 0)}.items():
        metres[index] += off_m
    place, reason = fit_to_map(places, metres, "EPSG:32615", [f"{index}.jpg" for index in range(12)])
    assert place is None
    assert re.match(r"4 of 11 positions, more than a third, disagree with the others, by 1\d\d.\d to 300.\d m", reason)
    assert "farthest off: 5.jpg, 6.jpg, 9.jpg, 2.jpg, " in reason


@pytest.mark.parametrize(
    ("metres_per_px", "spread_px", "message"),
    [(5e-7, 3000, "5e-07 m per pixel is finer"), (1e-4, 300, "the positions spread over 0.0"), (1e-3, 1000, "")],
)
def test_a_map_that_is_too_small_to_be_one_is_refused(metres_per_px: float, spread_px: float, message: str) -> None:
    """Degrees that are read as metres."""
    points = np.random.default_rng(6).uniform(0, spread_px, (9, 2))
    found, reason = fit_to_map(points, points * metres_per_px * [1, -1] + [500_000, 5e6], "EPSG:32615")
    assert (found is None) == bool(message)
    assert message in reason
