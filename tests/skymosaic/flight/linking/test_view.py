import dataclasses
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from golden_model.cache import Cache
from golden_model.config import preset_config
from sim.scene import make_pair
from skymosaic.common.errors import InputError
from skymosaic.features.positions import feature_points
from skymosaic.flight.linking.view import Settings, View, describe, describe_thumbnail
from skymosaic.imagery.lens import load_lens
from skymosaic.imagery.photographs import Source, list_sources


def test_masked_places_have_no_features(tmp_path: Path) -> None:
    mask = np.full((480, 640), 255, np.uint8)
    mask[300:] = 0
    cv2.imwrite(str(tmp_path / "mask.png"), mask)
    lens = load_lens(None, tmp_path / "mask.png")
    image = make_pair(seed=1).images[0]
    source = Source(0, "image", image)
    free = describe(source, Settings(preset_config("aerial")))
    masked = describe(source, Settings(preset_config("aerial"), lens=lens))
    assert len(masked.features) < len(free.features)
    assert feature_points(masked.features)[:, 1].max() < 300
    assert feature_points(free.features)[:, 1].max() > 400
    assert masked.key != free.key


def test_a_view_survives_the_cache(tmp_path: Path) -> None:
    cache = Cache(tmp_path / "cache")
    source = Source(0, "image", make_pair(seed=1).images[0])
    view = describe(source, Settings(preset_config("aerial")))
    assert cache.load(view.key) is None
    cache.save(view.key, view.pack())
    stored = cache.load(view.key)
    assert stored
    again = View.unpack(stored, "renamed", view.key)
    np.testing.assert_array_equal(again.features, view.features)
    np.testing.assert_array_equal(again.thumbnail, view.thumbnail)
    assert again.features.dtype == view.features.dtype
    assert (again.size, again.gps) == (view.size, view.gps)
    np.testing.assert_array_equal(again.sharpness, view.sharpness)
    assert again.name == "renamed"


@pytest.mark.parametrize(("size", "width_px"), [((700, 16000), 1280), ((300, 400), 64)])
def test_a_photograph_that_cannot_be_reduced_is_named(size: tuple[int, int], width_px: int) -> None:
    source = Source(0, "pano", np.zeros(size, np.uint8))
    with pytest.raises(InputError, match=r"pano: .* is reduced to"):
        describe(source, Settings(preset_config("aerial"), working_width_px=width_px))


def test_a_tall_photograph_can_be_described() -> None:
    rng = np.random.default_rng(1)
    source = Source(0, "tall", rng.integers(0, 256, (4200, 500), dtype=np.uint8))
    assert describe(source, Settings(preset_config("aerial"))).working_size == (305, 2560)


def test_a_thumbnail_that_the_front_end_cannot_take_has_no_features_of_the_kind_that_others_have() -> None:
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


def test_what_is_clipped_is_black_or_white() -> None:
    image = np.repeat(np.array([2, 3, 252, 253, 128], np.uint8), 64)[None].repeat(240, axis=0)
    assert describe(Source(0, "bars", image), Settings(preset_config("aerial"))).clipped == pytest.approx(0.4)


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
