"""The blocks for `skymosaic export block`, with their vectors."""

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np

from golden_model import front_end as golden_front_end
from golden_model.arrays import Records
from golden_model.config import PRESETS, EstimatorConfig, MatcherConfig
from golden_model.feature import ilbp
from golden_model.formats import encode_response
from golden_model.fuzzy.sugeno import SugenoSystem
from golden_model.geometry.estimator import FrameMatches, estimate, homography_record
from golden_model.matching import correlation, rule_bases
from golden_model.matching.matcher import match
from golden_model.pixel import fast, gray, half, nms, smooth, sobel
from golden_model.records import FRAME_STATUS, MATCH, Tag
from hdl.blocks.chain import Chain, Descriptor
from hdl.blocks.flat import flat_values
from hdl.blocks.vectors import Block, Row, answer_rows, packet, padded_status, pixel_rows, rows, sample_image
from hdl.build import Build
from hdl.fuzzy.sugeno import Sugeno
from hdl.geometry.records import RecordEstimator
from hdl.matching.correlation import WindowCorrelation
from hdl.matching.matcher import Matcher
from hdl.pixel.corners import Corners
from hdl.pixel.fast import WINDOW_PX, Fast
from hdl.pixel.gradients import GradientColumns
from hdl.pixel.gray import Gray
from hdl.pixel.half import Half
from hdl.pixel.harris import RawResponse, ResponseCode, StructureTensor
from hdl.pixel.nms import Suppression
from hdl.pixel.smooth import Binomial
from hdl.pixel.sobel import Sobel
from hdl.pixel.window import LineBuffer

CONFIG = PRESETS["aerial"].front_end
WIDTH_PX = Build.max_width_px
"""Longest line that the blocks accept; the test benches send shorter ones."""
SMALL_FRAME_PX = 64
MATCHED_FRAME_PX = 160
"""Has some ninety features, twelve times as many as the matcher compares at once."""


def _gray() -> Block:
    image = np.stack([sample_image(seed=seed) for seed in (1, 2, 3)], axis=-1)
    # Green in the lowest byte, then blue, red: the order of UG934.
    beats = image.astype(int) @ (1 << 8, 1, 1 << 16)
    return Block(
        Gray(),
        "Luma of RGB pixels, or gray pixels unchanged.",
        {"i": pixel_rows(data=beats)},
        {"o": answer_rows(pixel=gray.to_gray(image))},
        {"i_gray_input": 0},
    )


def _half() -> Block:
    image = sample_image()
    halved = half.halve(image)
    return Block(
        Half(width_px=WIDTH_PX),
        "Mean of each 2x2 pixels.",
        {"i": pixel_rows(pixel=image)},
        {"o": answer_rows(pixel=halved)},
    )


def _window(
    block: Any, lines: int, description: str, margin_px: int, settings: Row | None = None, **planes: Any
) -> Block:
    """Put a block that takes columns of pixels behind the line memory that makes them."""
    lag_px = getattr(block, "lag_px", 0)
    chain = Chain({"lines": LineBuffer(shape=8, lines=lines, width_px=WIDTH_PX), "block": block}, lag_px=lag_px)
    answers = answer_rows(lag_px=lag_px, margin_px=margin_px, **planes)
    return Block(chain, description, {"i": pixel_rows(pixel=sample_image())}, {"o": answers}, settings or {})


def _smooth() -> Block:
    return _window(Binomial(window_px=3), 2, "Binomial smoothing, 3x3.", 1, pixel=smooth.binomial(sample_image(), 3))


def _sobel() -> Block:
    x, y = sobel.gradients(sample_image())
    return _window(Sobel(), 2, "Sobel gradients.", 1, gradient_x=x, gradient_y=y)


def _fast() -> Block:
    code, threshold = fast.response_code(sample_image(), 12), {"i_threshold_code": 12}
    return _window(Fast(), WINDOW_PX - 1, "FAST-9/16: segment test and score.", fast.MARGIN_PX, threshold, code=code)


def _planes() -> dict[str, golden_front_end.Plane]:
    config = dataclasses.replace(CONFIG, levels=1, threshold=1000)
    return golden_front_end.trace(sample_image(SMALL_FRAME_PX, SMALL_FRAME_PX), config).levels[0]


def _harris() -> Block:
    response = _planes()["response_code"]
    columns = GradientColumns(smoothed=CONFIG.smoothed_gradients, width_px=WIDTH_PX)
    tensor = StructureTensor(window_px=CONFIG.tensor_window_px)
    lag_px = columns.gradient_lag_px + tensor.lag_px
    chain = Chain(
        {
            "lines": LineBuffer(shape=8, lines=2, width_px=WIDTH_PX),
            "columns": columns,
            "tensor": tensor,
            "raw": RawResponse(k_numerator=CONFIG.harris_k_numerator, k_shift=CONFIG.harris_k_shift),
            "code": ResponseCode(),
        },
        lag_px=lag_px,
        fields={"column": "gradients"},
        constants={"i_fast": 0},
    )
    return Block(
        chain,
        "Harris's corner response as a logarithmic code; 0 below the threshold.",
        {"i": pixel_rows(pixel=sample_image(SMALL_FRAME_PX, SMALL_FRAME_PX))},
        {"o": answer_rows(lag_px=lag_px, margin_px=response.margin_px, code=response.values)},
        {"i_threshold_code": int(encode_response(np.array(1000)))},
    )


def _nms() -> Block:
    radius_px = CONFIG.suppression_radius_px
    codes = np.asarray(np.random.default_rng(4).integers(0, 40, (26, 30)), np.uint16)
    return Block(
        Suppression(radius_px=radius_px, width_px=WIDTH_PX),
        f"Non-maximum suppression in a window of {2 * radius_px + 1}x{2 * radius_px + 1} px.",
        {"i": pixel_rows(code=codes)},
        {"o": answer_rows(lag_px=radius_px, margin_px=radius_px, code=nms.suppress(codes, radius_px))},
        {"i_fast": 0},
    )


def _corners() -> Block:
    image, response = sample_image(SMALL_FRAME_PX, SMALL_FRAME_PX), _planes()["response_code"]
    block, radius_px = Corners(config=CONFIG, width_px=WIDTH_PX), CONFIG.suppression_radius_px
    survivors = nms.suppress(response.values, radius_px)
    chain = Chain({"lines": LineBuffer(shape=8, lines=2, width_px=WIDTH_PX), "corners": block}, lag_px=block.lag_px)
    return Block(
        chain,
        "Harris or FAST corners after suppression, with the codes of the four neighbours.",
        {"i": pixel_rows(pixel=image)},
        {"o": answer_rows(lag_px=block.lag_px, margin_px=response.margin_px + radius_px, code=survivors)},
        {"i_fast": 0, "i_threshold_code": int(encode_response(np.array(1000)))},
    )


def _ilbp() -> Block:
    pattern, size_px = CONFIG.pattern, 41
    scene = np.concatenate([sample_image(size_px, size_px, seed) for seed in range(24)])
    y = np.arange(24) * size_px + size_px // 2
    x = np.full_like(y, size_px // 2)
    sectors, descriptors = ilbp.describe(scene, scene, x, y, pattern)
    rings = ilbp.gather(scene, x, y, [offset for ring in pattern.offsets for offset in ring]).T
    sent = [{"rings": ring.reshape(len(pattern.radii_px), -1).tolist()} for ring in rings]
    expected = [
        {"sector": sector, "descriptor": int.from_bytes(row.tobytes(), "little")}
        for sector, row in zip(sectors.tolist(), descriptors, strict=True)
    ]
    block = Descriptor(pattern=pattern)
    return Block(
        block,
        f"Orientation and descriptor ({pattern.name}) of the pixels on rings around a candidate.",
        {"i": rows("i", sent)},
        {"o": rows("o", expected)},
        spacing_cycles=block.spacing_cycles,
    )


def sugeno(system: SugenoSystem, value_bits: int, description: str, *, vectors: int) -> Block:
    """Make a block of a Sugeno system, with ``vectors`` at random, and those at the ends of its tables."""
    last = [each.entries - 1 for each in system.inputs]
    # The largest values lie beyond the tables, which then give their last degree.
    ends = [[0] * len(last), last, [(1 << value_bits) - 1] * len(last)]
    random = np.random.default_rng(5).integers(0, 1 << value_bits, (vectors, len(last)))
    inputs = np.vstack([ends, random])
    weights, chosen = system.evaluate(*inputs.T)
    expected = [
        {"weight": weight, "rule": rule} for weight, rule in zip(weights.tolist(), chosen.tolist(), strict=True)
    ]
    return Block(
        Sugeno(system=system, value_bits=value_bits),
        description,
        {"i": rows("i", inputs.tolist())},
        {"o": rows("o", expected)},
    )


def _fuzzy() -> Block:
    system = rule_bases.aerial_orientation(CONFIG.pattern.bits)
    names = ", ".join(variable.name for variable in system.inputs)
    description = f"Zero-order Sugeno system with the inputs {names}: weight (UQ0.8) and dominant rule."
    # 6 bits, because its tables are short: most values of 8 bits lie beyond them.
    return sugeno(system, value_bits=6, description=description, vectors=60)


def _correlation() -> Block:
    left, right = np.random.default_rng(6).integers(0, 256, (2, 30, 9)).astype(np.uint8)
    scores = zip(
        *(score(left, right).tolist() for score in (correlation.sad, correlation.zssd, correlation.ncc)), strict=True
    )
    return Block(
        WindowCorrelation(),
        "SAD, ZSSD and NCC of two windows of 3x3 pixels.",
        {"i": rows("i", [{"left": a, "right": b} for a, b in zip(left.tolist(), right.tolist(), strict=True)])},
        {"o": rows("o", [dict(zip(("sad", "zssd", "ncc"), each, strict=True)) for each in scores])},
    )


def _frames() -> list[golden_front_end.FrameFeatures]:
    scene = sample_image(MATCHED_FRAME_PX, MATCHED_FRAME_PX + 8)
    config = dataclasses.replace(CONFIG.for_size(MATCHED_FRAME_PX, MATCHED_FRAME_PX), levels=1, max_features=256)
    views = (np.ascontiguousarray(scene[:, shift : shift + MATCHED_FRAME_PX]) for shift in (0, 8))
    return [golden_front_end.extract(view, config, frame=number) for number, view in enumerate(views)]


def matcher(config: MatcherConfig = PRESETS["aerial"].matcher) -> Block:
    """Make a block of the matcher, with two frames whose matches are decided by the rules of ``config``."""
    pattern, frames = CONFIG.pattern, _frames()
    matches = match(frames[0].features, frames[1].features, pattern, config)
    counts = {"matches": len(matches), "kept": int(np.count_nonzero(matches["verdict"]))}
    sent: list[Any] = []
    for frame in frames:
        sent += packet(frame.features, padded_status(frame.status, frame.features.dtype.itemsize))
    expected = packet(padded_status(frames[0].status, MATCH.record_bytes))
    expected += packet(matches, padded_status(frames[1].status, MATCH.record_bytes, **counts))
    return Block(
        Matcher(config=config, pattern=pattern, lanes=8, max_features=256),
        "Mutual nearest neighbours by Hamming distance, weighed by fuzzy rules: feature packets in, match packets out.",
        {"i_features": rows("i_features", sent)},
        {"o_matches": rows("o_matches", expected)},
        dict.fromkeys(("i_estimating", "i_refused", "i_hold_reference", "i_take_reference"), 0)
        | {"i_keep_above": config.keep_above},
    )


def _match_packet(count: int, spread: int) -> tuple[Records, np.void]:
    """Match records whose positions differ by up to ``spread``, 1/16 px, a fifth of them rejected; and the status."""
    rng = np.random.default_rng(8)
    matches = np.zeros(count, MATCH.dtype)
    left = rng.integers(0, 1 << 13, (count, 2))
    right = np.abs(left + rng.integers(-spread, spread + 1, left.shape))
    matches["tag"], matches["weight"] = Tag.MATCH, rng.integers(0, 256, count)
    matches["verdict"] = rng.random(count) < 0.8
    for side, points in (("left", left), ("right", right)):
        matches[f"{side}_x"], matches[f"{side}_y"] = points.T
    status: np.void = np.zeros(1, FRAME_STATUS.dtype)[0]
    for name, value in {"tag": Tag.FRAME_STATUS, "good": 1, "width": 512, "height": 512}.items():
        status[name] = value
    return matches, status


def _homography() -> Block:
    matches, status = _match_packet(30, spread=20)
    settings = EstimatorConfig(passes=1)
    result = estimate(FrameMatches.from_records(matches, status), settings)
    return Block(
        RecordEstimator(),
        "Estimates the homography of each frame's kept matches: packets of matches in, a packet of one record out for "
        "each.",
        {"i_matches": rows("i_matches", packet(matches, padded_status(status, MATCH.record_bytes)))},
        {"o": rows("o", packet(homography_record(result)))},
        flat_values("i_settings", vars(settings)) | {"i_enable": 1, "i_clear": 0},
    )


CATALOGUE: dict[str, Callable[[], Block]] = {
    "gray": _gray,
    "half": _half,
    "smooth": _smooth,
    "sobel": _sobel,
    "harris": _harris,
    "fast": _fast,
    "nms": _nms,
    "corners": _corners,
    "ilbp": _ilbp,
    "fuzzy": _fuzzy,
    "correlation": _correlation,
    "matcher": matcher,
    "homography": _homography,
}
"""For each block's name, the function that builds it."""
