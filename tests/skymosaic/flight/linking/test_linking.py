"""Views of photographs, links between them, and photographs that resemble each other."""

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from golden_model.arrays import Pixels
from golden_model.config import preset_config
from golden_model.feature.orientation import SECTORS
from golden_model.formats import POSITION
from golden_model.front_end import extract
from golden_model.matching.hamming import distances, mutual_matches
from sim.scene import make_lawnmower, make_pair
from skymosaic.common.errors import InputError
from skymosaic.flight.linking.links import are_right, link_views, tie_views
from skymosaic.flight.linking.resemblance import (
    CLOSE_BITS,
    COMPACT_FEATURES,
    PARTNERS,
    compact,
    count_votes,
    likely_pairs,
)
from skymosaic.flight.linking.view import Settings, describe, describe_thumbnail
from skymosaic.geometry.ground import Sight
from skymosaic.geometry.homography import transfer_error
from skymosaic.imagery.photographs import Source, list_sources


def test_photographs_of_any_shape_are_described_alike() -> None:
    rng = np.random.default_rng(1)
    source = Source(0, "tall", rng.integers(0, 256, (4200, 500), dtype=np.uint8))
    assert describe(source, Settings(preset_config("aerial"))).working_size == (305, 2560)
    source = Source(0, "strip", np.random.default_rng(1).integers(0, 256, (64, 640), dtype=np.uint8))
    first = Settings(preset_config("aerial"))
    more = first.with_more_features()
    assert more is not None
    view = describe(source, first)
    for settings in (first, more):
        reduced = describe_thumbnail(view.thumbnail, view, settings)
        assert len(reduced.features) == len(reduced.strongest) == 0
        # Those of other photographs are compared with these.
        assert reduced.strongest.dtype == describe(source, settings).strongest.dtype


@pytest.mark.parametrize(
    ("changed", "is_more"),
    [
        ({}, True),
        ({"descriptor": "ilbp-256"}, False),
        ({"selection": False, "levels": 1, "cell_px": None, "per_cell": None}, False),
    ],
)
def test_only_what_selects_few_short_features_can_have_more(changed: dict[str, Any], is_more: bool) -> None:
    config = preset_config("aerial")
    known = Settings(dataclasses.replace(config, front_end=dataclasses.replace(config.front_end, **changed)), "rtl")
    more = known.with_more_features()
    assert (more is not None) is is_more
    if more is not None:
        assert (more.backend, more.config.front_end.descriptor) == ("golden", "ilbp-256")
        assert more.config.front_end.max_features == 4096


def test_a_flight_leaves_a_damaged_photograph_out_unless_it_is_kept(tmp_path: Path) -> None:
    data = bytearray(cv2.imencode(".jpg", make_pair(seed=1).images[0])[1].tobytes())
    data[len(data) // 2 : len(data) // 2 + 400] = bytes(400)
    (tmp_path / "damaged.jpg").write_bytes(data)
    (source,) = list_sources([tmp_path])
    settings = Settings(preset_config("aerial"))
    with pytest.raises(InputError, match=r"damaged\.jpg: the JPEG is damaged"):
        describe(source, settings)
    kept = dataclasses.replace(source, keep_damaged=True)
    assert settings.key(kept) != settings.key(source)
    assert "kept although" in describe(kept, settings).notes[0]


def test_the_code_of_the_backend_is_part_of_the_key(monkeypatch: pytest.MonkeyPatch) -> None:
    source = Source(0, "image", np.zeros((64, 64), np.uint8))
    settings = Settings(preset_config("aerial"))
    before = settings.key(source)
    monkeypatch.setattr("skymosaic.flight.linking.view.digest_code", lambda module: f"changed {module}")
    assert settings.key(source) != before


def see(images: Sequence[Pixels]) -> tuple[Sight, Sight]:
    return Sight(images[0]), Sight(images[1])


def test_matches_on_relief_are_right_and_others_are_not() -> None:
    rng = np.random.default_rng(0)
    plane = np.array([[1.0, 0, 200], [0, 1, 10], [0, 0, 1]])
    left = rng.uniform(0, 1000, (300, 2))
    right = left + np.array([200, 10]) + rng.normal(0, 0.2, left.shape)
    on_relief, false, near_but_false = slice(0, 60), slice(60, 120), slice(120, 140)
    # Parallax moves along the baseline, here to the right and a little down.
    right[on_relief] += rng.uniform(5, 50, (60, 1)) * [1, 0.05]
    right[false] = rng.uniform(0, 1000, (60, 2))
    right[near_but_false] += rng.uniform(5, 50, (20, 1)) * [0.2, 1]
    kept = are_right(left, right, plane)
    assert kept[on_relief].mean() > 0.95
    assert kept[140:].mean() > 0.95
    assert kept[false].mean() < 0.05
    assert kept[near_but_false].mean() < 0.1
    np.testing.assert_array_equal(are_right(left, right, plane), kept)


def test_a_single_tie_links_no_views() -> None:
    points = np.array([[10.0, 20], [300, 40]])
    assert not tie_views((0, 1), points[:1], points[:1], np.eye(3), 12).holds
    assert tie_views((0, 1), points, points, np.eye(3), 12).holds


def test_checks_are_no_ties_and_lie_on_relief_too() -> None:
    config = preset_config("aerial")
    flight = make_lawnmower(3, 4, (640, 480), relief=True)
    features = [extract(image, config.front_end).features for image in flight.images[:2]]
    link = link_views((0, 1), *features, config=config, seed=0, sights=see(flight.images))
    assert link.ties > 2 * len(link.left_checks) > 50
    ties = {tuple(point) for point in link.left_points.tolist()}
    assert ties.isdisjoint(tuple(point) for point in link.left_checks.tolist())
    on_plane = flight.homography_between(0, 1)
    off_px = transfer_error(on_plane, link.left_checks, link.right_checks)
    assert off_px.max() > 3
    assert len(link.left_relief) > len(link.left_checks) / 20
    assert transfer_error(on_plane, link.left_relief, link.right_relief).min() > 2
    # What shapes meshes is no tie, and no check of what they gain.
    others = ties | {tuple(point) for point in link.left_checks.tolist()}
    assert others.isdisjoint(tuple(point) for point in link.left_relief.tolist())
    again = type(link).unpack(link.pack(), 0, 1)
    np.testing.assert_array_equal(again.right_checks, link.right_checks)


def test_twins_of_features_are_told_apart_near_the_place_that_a_layout_predicts() -> None:
    config = preset_config("aerial")
    flight = make_lawnmower(3, 4, (480, 360))
    left, right = (extract(image, config.front_end).features for image in flight.images[:2])
    how: dict[str, Any] = {"config": config, "seed": 0, "sights": see(flight.images)}
    twins, rng = right.copy(), np.random.default_rng(0)
    for axis in ("x", "y"):
        twins[axis] += rng.integers(40, 200, len(twins), np.uint16) * POSITION.one
    # The first of equal descriptors is taken.
    right = np.concatenate([twins, right])
    assert not link_views((0, 1), left, right, **how).holds
    truth = flight.homography_between(0, 1)
    off = np.array([[1.0, 0, 15], [0, 1, -20], [0, 0, 1]])
    link = link_views((0, 1), left, right, **how, predicted=off @ truth)
    assert link.ties > 2 * len(link.left_checks) > 50
    for points in ((link.left_points, link.right_points), (link.left_checks, link.right_checks)):
        assert np.median(transfer_error(truth, *points)) < 0.5
    # Farther than the search, nothing is found, however well it would match.
    farther = np.array([[1.0, 0, 30], [0, 1, -30], [0, 0, 1]])
    assert not link_views((0, 1), left, right, **how, predicted=farther @ truth).holds


VIEWS, SHARED, WRONG_BITS = 100, 24, 0.1
DESCRIPTOR = np.dtype([("descriptor", np.uint8, 16)])


def test_votes_count_as_the_matcher_would() -> None:
    grain = np.random.default_rng(3).integers(0, 256, (240, 400), dtype=np.uint8)
    ground = cv2.normalize(cv2.GaussianBlur(grain, (0, 0), 2), None, 0, 255, cv2.NORM_MINMAX)
    config = preset_config("aerial").front_end
    one, other = (compact(extract(view, config).features) for view in (ground[:, :320], ground[:, 80:]))
    bits = 8 * one["descriptor"].shape[1]
    left, right, best, _ = mutual_matches(distances(one["descriptor"], other["descriptor"]), bits)
    close = best <= CLOSE_BITS * bits
    turn = (other["sector"][right[close]] - one["sector"][left[close]]) % SECTORS
    counts = np.bincount(turn, minlength=SECTORS)
    assert count_votes(one, [other, other[:0]]) == [
        max((counts + np.roll(counts, 1) + np.roll(counts, -1)).tolist()),
        0,
    ]
    assert count_votes(one, [other])[0] > 50
    assert count_votes(one, [other])[0] == pytest.approx(count_votes(other, [one])[0], abs=2)


def ring(rng: np.random.Generator) -> list[NDArray[np.void]]:
    """Views of which each shares some of its features, seen a little differently, with the next one."""
    bits = rng.integers(0, 2, (VIEWS, COMPACT_FEATURES, 128), dtype=np.uint8)
    bits[:, :SHARED] = np.roll(bits, 1, axis=0)[:, SHARED : 2 * SHARED] ^ (
        rng.random((VIEWS, SHARED, 128)) < WRONG_BITS
    )
    # Words that every view has, as of flat ground, must not count.
    bits[:, -50:] = bits[0, -50:]
    views = np.zeros((VIEWS, COMPACT_FEATURES), DESCRIPTOR)
    views["descriptor"] = np.packbits(bits, axis=2)
    return list(views)


def test_likely_pairs_share_features_or_are_few() -> None:
    pairs = likely_pairs(ring(np.random.default_rng(5)))
    neighbours = {(view, view + 1) for view in range(VIEWS - 1)} | {(0, VIEWS - 1)}
    assert neighbours <= set(pairs)
    assert pairs == sorted(set(pairs))
    assert all(left < right for left, right in pairs)
    assert len(pairs) <= VIEWS * PARTNERS
    views = ring(np.random.default_rng(6))[: PARTNERS + 1]
    assert likely_pairs(views) == [(i, j) for i in range(PARTNERS + 1) for j in range(i + 1, PARTNERS + 1)]
    assert likely_pairs([views[0], views[1][:0]]) == [(0, 1)]
    assert likely_pairs([views[0][:0], views[1][:0]]) == [(0, 1)]
    assert likely_pairs(views[:1]) == []
