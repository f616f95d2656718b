"""The Python API: positions in original pixels, one-line representations, and examples that run."""

import doctest
import importlib.util
import pickle
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

import skymosaic
from sim.scene import make_lawnmower, make_pair
from skymosaic.common.errors import InputError, RegistrationError
from skymosaic.geometry.homography import apply
from skymosaic.registration.pair import KINDS, Pair


@pytest.fixture(scope="module")
def pair() -> Pair:
    """Photographs three times as wide as what is registered: naive use of the records would be far off."""
    left, right = make_pair(seed=5, size=(400, 300)).images
    large = [cv2.resize(image, None, fx=2, fy=2, interpolation=cv2.INTER_CUBIC) for image in (left, right)]
    return skymosaic.register(*large, working_width_px=400)


@pytest.mark.parametrize("kind", KINDS)
def test_points_are_in_original_pixels(pair: Pair, kind: str) -> None:
    left, right, weights, rules = pair.points(kind)
    count = len(getattr(pair, kind))
    assert left.shape == right.shape == (count, 2)
    assert left.dtype == right.dtype == weights.dtype == np.float64
    assert len(weights) == len(rules) == count
    assert left.max() > 400
    assert pair.homography is not None
    errors_px = np.linalg.norm(apply(pair.homography, left) - right, axis=1)
    # 2 px of the working images are 4 of these; proposals contain wrong ones.
    assert (errors_px.max() if kind == "inliers" else np.median(errors_px)) < 4.1
    assert (weights >= 0).all()
    assert (weights <= 1).all()
    assert all(" " in rule for rule in rules)


def test_features_are_those_of_a_pair_and_kinds_are_named(pair: Pair) -> None:
    with pytest.raises(InputError, match="inliers, kept, matches"):
        pair.points("good")
    features = skymosaic.extract(pair.left.pixels, working_width_px=400)
    matched = pair.points("matches").left
    distances = np.linalg.norm(matched[:, None] - features.points[None], axis=2).min(axis=1)
    assert distances.max() < 1e-9
    assert len(features) == len(features.descriptors) == len(features.angles) == len(pair.features[0])
    assert 0 <= features.angles.min() < features.angles.max() < 2 * np.pi


def test_pairs_share_features_and_find_the_same(pair: Pair) -> None:
    left, right = (skymosaic.extract(side.pixels, working_width_px=400) for side in (pair.left, pair.right))
    once = skymosaic.register(pair.left.pixels, pair.right.pixels, working_width_px=400, effort="thorough")
    for sides in ((left, right), (left, pair.right.pixels), (left, right)):
        again = skymosaic.register(*sides, working_width_px=400, effort="thorough")
        np.testing.assert_array_equal(again.matches, once.matches)
        np.testing.assert_array_equal(again.homography, once.homography)
        # Three scales, and twice the size of small photographs.
        assert again.passes == once.passes == 4
    assert len(left.working.kept) == 3
    with pytest.raises(InputError, match="image: its features were extracted with other options"):
        skymosaic.register(left, right)
    with pytest.raises(InputError, match="features of sift are not shared"):
        skymosaic.register(left, right, detector="sift")


def test_a_pickled_pair_keeps_its_numbers(pair: Pair, tmp_path: Path) -> None:
    names = [tmp_path / "left.png", tmp_path / "right.png"]
    for name, side in zip(names, (pair.left, pair.right), strict=True):
        cv2.imwrite(str(name), side.pixels)
    made = skymosaic.register(names[0], names[1], working_width_px=400)
    data = pickle.dumps(made)
    assert len(data) < 1_000_000
    again = pickle.loads(data)
    assert again.summary() == made.summary()
    np.testing.assert_array_equal(again.points().left, made.points().left)
    assert "base64" in made._repr_html_()
    assert "base64" not in again._repr_html_()


@pytest.mark.parametrize("photographs", [2, 3])
def test_a_layout_is_repeated_with_photographs_of_another_day(photographs: int) -> None:
    images = make_lawnmower(1, photographs, (320, 240)).images
    made = skymosaic.mosaic(images)
    again = skymosaic.mosaic([image // 2 for image in images], repeat=made)
    assert again.transforms.keys() == made.transforms.keys()
    for index, transform in made.transforms.items():
        np.testing.assert_array_equal(again.transforms[index], transform)
    assert again.image.mean() == pytest.approx(made.image.mean() / 2, rel=0.1)
    assert "base64" in again._repr_html_()
    with pytest.raises(InputError, match=f"`repeat`: a mosaic of {photographs} photographs, not of 4"):
        skymosaic.mosaic([*images, *images][:4], repeat=made)
    with pytest.raises(InputError, match="different sizes"):
        skymosaic.mosaic([images[0][:200], *images[1:]], repeat=made)


def test_completion_offers_the_public_names_alone() -> None:
    assert dir(skymosaic) == sorted(skymosaic.__all__)
    assert all(hasattr(skymosaic, name) for name in dir(skymosaic))


def test_a_mosaic_without_gps_has_no_place_on_the_map(pair: Pair, tmp_path: Path) -> None:
    made = skymosaic.mosaic([pair.left.pixels, pair.right.pixels])
    with pytest.raises(RegistrationError, match=r"0 of 2 photographs have GPS.*; nothing was written$"):
        made.save(tmp_path / "m.tif", require_map=True)
    with pytest.raises(InputError, match=r"m\.png: \.png files are no maps"):
        made.save(tmp_path / "m.png", require_map=True)
    assert not list(tmp_path.iterdir())
    (tmp_path / "m.tif").touch()
    with pytest.raises(InputError, match="overwrite"):
        made.save(tmp_path / "m.tif")


DOCUMENTED = (
    "mosaicking.live.mosaic",
    "mosaicking.api",
    "mosaicking.pairs",
    "registration.extraction",
    "registration.pair",
    "registration.register",
    "tracking.tracker",
)


@pytest.mark.parametrize("module", DOCUMENTED)
def test_the_examples_in_docstrings_run(module: str) -> None:
    results = doctest.testmod(importlib.import_module(f"skymosaic.{module}"))
    assert results.attempted > 0
    assert results.failed == 0


@pytest.fixture(scope="module")
def public(pair: Pair) -> dict[str, Any]:
    """An object of each public class whose work is done: a live mosaic and a tracker hold processes."""
    frames = [np.asarray(image) for image in make_lawnmower(3, 3, (320, 240)).images]
    with skymosaic.LiveMosaic() as live:
        updates = [live.add(frame) for frame in frames]
    with skymosaic.Tracker(skymosaic.Roi(100, 80, 120, 90)) as tracker:
        tracked = [tracker.follow(frames[0]) for _ in range(2)]
    objects: list[Any] = [
        pair,
        pair.without_pixels(),
        pair.points(),
        pair.confidence,
        pair.left,
        pair.left.without_pixels(),
    ]
    objects += [skymosaic.extract(frames[0]), skymosaic.mosaic(frames), updates[-1], tracked[-1], pair.config]
    objects += [skymosaic.Roi(1, 2, 3, 4), skymosaic.MosaicOptions(), skymosaic.TrackerOptions()]
    named = [type(each).__name__ for each in objects]
    return {f"{name} {named[:n].count(name)}": each for n, (name, each) in enumerate(zip(named, objects, strict=True))}


PUBLIC = (
    "Pair 0", "Pair 1", "MatchedPoints 0", "Confidence 0", "Photograph 0", "Photograph 1", "Features 0", "Mosaic 0",
    "LiveUpdate 0", "TrackedFrame 0", "Config 0", "Roi 0", "MosaicOptions 0", "TrackerOptions 0",
)  # fmt: skip


def numbers_of(value: Any, depth: int = 4) -> Any:
    """What a user reads of an object, but pixels: attributes, properties, and what can be asked without an argument."""
    if isinstance(value, np.ndarray):
        return "pixels" if value.dtype == np.uint8 and value.ndim >= 2 else value.tolist()
    if isinstance(value, dict | list | tuple) and not hasattr(value, "_asdict"):
        items = value.items() if isinstance(value, dict) else enumerate(value)
        return {key: numbers_of(each, depth) for key, each in items}
    if depth == 0 or not type(value).__module__.startswith(("skymosaic", "golden_model")):
        return repr(value).partition(" at 0x")[0]
    names = {name for name in dir(value) if not name.startswith("_") and not callable(getattr(value, name))}
    numbers = {name: numbers_of(getattr(value, name), depth - 1) for name in names - PIXELS}
    asked = [name for name in ("summary", "table", "row") if hasattr(value, name)]
    return numbers | {f"{name}()": numbers_of(getattr(value, name)(), depth) for name in asked}


PIXELS = {"pixels", "image", "working", "visible", "known_evidence"}
"""Pictures, and what stands in for them where they are not kept."""


@pytest.mark.filterwarnings("ignore::RuntimeWarning")  # Means of what a flight without a map has not.
@pytest.mark.parametrize("name", PUBLIC)
def test_a_public_object_keeps_its_numbers_when_pickled_and_is_one_line_when_printed(
    public: dict[str, Any], name: str
) -> None:
    assert public.keys() == set(PUBLIC)
    given = public[name]
    read = pickle.loads(pickle.dumps(given))
    assert repr(numbers_of(read)) == repr(numbers_of(given))
    assert repr(read).startswith(type(given).__name__)
    assert len(repr(read)) < 1000
    assert "\n" not in repr(given)


def test_a_live_object_says_why_it_is_not_pickled() -> None:
    for live in (skymosaic.LiveMosaic(), skymosaic.Tracker(skymosaic.Roi(100, 80, 120, 90))):
        name = type(live).__name__
        with pytest.raises(TypeError, match=f"^a {name} holds a front end.*, so it is not pickled; its .* are$"):
            pickle.dumps(live)
