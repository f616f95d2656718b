"""The whole front end: its features agree with the planes of its stages, and with what must not change them."""

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from golden_model.config import PRESETS, FrontEndConfig
from golden_model.feature import ilbp
from golden_model.formats import decode_response, encode_response
from golden_model.front_end import BAND_PX, Plane, extract, trace
from golden_model.pixel.smooth import binomial
from golden_model.records import Cause, Tag

AERIAL = PRESETS["aerial"].front_end
FAST = FrontEndConfig(detector="fast", threshold=20)
THESIS = dataclasses.replace(PRESETS["thesis"].front_end, threshold=2_000_000)
CONFIGS = pytest.mark.parametrize("config", [AERIAL, FAST, THESIS], ids=["aerial", "fast", "thesis"])


def level_positions(features: NDArray[np.void], level: int) -> NDArray[np.int64]:
    """Positions of features in their level, 1/16 px; not rounded, since an offset can be exactly half a pixel."""
    fine = np.stack((features["x"], features["y"])).astype(np.int64)
    return fine if level == 0 else (fine - 8) // 2


def near(plane: NDArray[np.uint16], fine: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Pixel of the only candidate within 8/16 px of each fine position, in x and in y."""
    rows, columns = np.nonzero(plane)
    distance = np.abs(np.stack((columns, rows))[:, None, :] * 16 - fine[:, :, None]).max(axis=0)
    assert ((distance <= 8).sum(axis=1) == 1).all()
    nearest = distance.argmin(axis=1)
    return columns[nearest], rows[nearest]


@CONFIGS
@pytest.mark.parametrize("height_px", [3 * BAND_PX - 1, 3 * BAND_PX + 1])
def test_bands_meet(texture: Callable[..., Any], config: FrontEndConfig, height_px: int) -> None:
    image = texture(height_px, 160)
    features = extract(image, config).features
    assert len(features) > 50
    np.testing.assert_array_equal(features, trace(image, config).result.features)


@CONFIGS
def test_every_feature_is_what_its_planes_say(texture: Callable[..., Any], config: FrontEndConfig) -> None:
    image = texture(240, 320)
    result = trace(image, config)
    features = result.result.features
    assert len(features) > 300
    extracted = extract(image, config)
    np.testing.assert_array_equal(features, extracted.features)
    assert result.result.status == extracted.status
    for level, planes in enumerate(result.levels):
        values = {name: plane.values for name, plane in planes.items()}
        chosen = features[features["level"] == level]
        assert len(chosen) > 20
        fine = level_positions(chosen, level)
        x, y = near(values["candidates"], fine)
        np.testing.assert_array_equal(chosen["response"], values["candidates"][y, x])
        r = decode_response(values["response_code"]).astype(float)
        for measured, (dx, dy), centre in zip(fine, ((1, 0), (0, 1)), (x, y), strict=True):
            u, v = r[y, x] - r[y + dy, x + dx], r[y, x] - r[y - dy, x - dx]
            top = np.divide(v - u, 2 * (u + v), out=np.zeros_like(u), where=u + v > 0)
            assert np.abs(measured / 16 - centre - top).max() <= 1 / 32
        smoothed5 = binomial(values["gray"], 5)
        sector, descriptor = ilbp.describe(values["gray"], smoothed5, x, y, config.pattern)
        np.testing.assert_array_equal(chosen["sector"], sector)
        np.testing.assert_array_equal(chosen["descriptor"], descriptor)
        if config.pattern.carries_window:
            windows = [values["gray"][v - 1 : v + 2, u - 1 : u + 2].ravel() for u, v in zip(x, y, strict=True)]
            np.testing.assert_array_equal(chosen["window"], windows)


@pytest.mark.parametrize("config", [AERIAL, FAST], ids=["aerial", "fast"])
def test_cells_keep_their_best_in_the_order_of_emission(texture: Callable[..., Any], config: FrontEndConfig) -> None:
    image = texture(333, 417)
    result = trace(image, config)
    settled = config.for_size(417, 333)
    assert settled.cell_px
    keys = []
    for level, planes in enumerate(result.levels):
        candidates = planes["candidates"].values
        y, x = (axis.tolist() for axis in np.nonzero(candidates))
        cells: dict[tuple[int, int], list[tuple[int, int, int]]] = {}
        for u, v in zip(x, y, strict=True):
            cells.setdefault((v // settled.cell_px, u // settled.cell_px), []).append((-int(candidates[v, u]), v, u))
        for (row, column), ranks in cells.items():
            turn = 3 * (row // 2) + row % 2 if level == 0 else 3 * row + 2
            keys += [(turn, column, *key, level) for key in sorted(ranks)[: settled.per_cell]]
    features = result.result.features
    assert [(-key[2], key[5]) for key in sorted(keys)] == list(
        zip(features["response"].tolist(), features["level"].tolist(), strict=True)
    )
    np.testing.assert_array_equal(features["index"], np.arange(len(features)))


@CONFIGS
def test_planes_are_specified_up_to_their_margin(texture: Callable[..., Any], config: FrontEndConfig) -> None:
    """Pixels beyond a frame's border must not influence a stage inside its margin."""
    image = texture(160, 200)
    whole, part = trace(image, config), trace(image[32:140, 48:190], config)
    for level, (around, planes) in enumerate(zip(whole.levels, part.levels, strict=True)):
        for name, plane in planes.items():
            height, width = plane.values.shape
            top, left = 32 >> level, 48 >> level
            # Candidates are specified everywhere, but to be 0 within the border.
            margin_px = config.border_px if name == "candidates" else plane.margin_px
            expected = Plane(around[name].values[top : top + height, left : left + width], margin_px).specified
            specified = Plane(plane.values, margin_px).specified
            np.testing.assert_array_equal(specified, expected, err_msg=f"{name}, level {level}")


@given(data=st.data())
@settings(max_examples=30)
def test_any_content_and_size(contents: Callable[..., Any], data: st.DataObject) -> None:
    config = data.draw(st.sampled_from([AERIAL, FAST, THESIS]))
    image = data.draw(contents(64, 110))
    result = extract(image, config, frame=7)
    assert result.status["tag"] == Tag.FRAME_STATUS
    assert (result.status["height"], result.status["width"]) == image.shape
    assert result.status["features"] == len(result.features)
    assert (result.features["tag"] == Tag.FEATURE).all()
    assert (result.features["frame"] == 7).all()
    for level in range(config.levels):
        chosen = result.features[result.features["level"] == level]
        fine = level_positions(chosen, level)
        limits = np.array([image.shape[1] >> level, image.shape[0] >> level])[:, None]
        assert (fine >= 16 * config.border_px - 8).all()
        assert (fine <= 16 * (limits - 1 - config.border_px) + 8).all()


def test_half_turn_mirrors_the_features(texture: Callable[..., Any]) -> None:
    # Cells of 32 px tile both levels of this frame, so that the half turn maps cells onto cells.
    image = texture(256, 256, seed=3)
    turned = np.ascontiguousarray(image[::-1, ::-1])
    first, second = extract(image, AERIAL).features, extract(turned, AERIAL).features
    expected = sorted(
        (level, 16 * 255 - x, 16 * 255 - y, r) for level, x, y, r in first[["level", "x", "y", "response"]]
    )
    assert sorted(second[["level", "x", "y", "response"]].tolist()) == expected
    assert len(expected) > 300


def test_a_frame_says_what_kept_its_features_away(texture: Callable[..., Any]) -> None:
    config = dataclasses.replace(THESIS, threshold=1, max_features=100)
    result = extract(texture(128, 160), config, frame=3)
    assert len(result.features) == 0
    assert result.status["good"] == 0
    assert result.status["causes"] == Cause.TOO_MANY_FEATURES
    assert (result.status["frame"], result.status["features"]) == (3, 0)
    result = extract(texture(128, 160), dataclasses.replace(AERIAL, threshold=1_000_003))
    assert result.status["threshold"] == encode_response(np.array(1_000_003))
    assert (result.features["response"] >= result.status["threshold"]).all()
    features = extract(texture(64, 79), AERIAL).features
    assert len(features) > 0
    assert not features["level"].any()


def test_size_out_of_range_is_refused() -> None:
    with pytest.raises(ValueError, match="frame width is 63"):
        extract(np.zeros((64, 63), np.uint8), AERIAL)
