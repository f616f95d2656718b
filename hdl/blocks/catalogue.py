# amaranth: UnusedElaboratable=no
# Blocks that are refused are never elaborated, of which whoever reads the refusal would be warned, too.
"""The blocks for `skymosaic export block`, with their vectors."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from golden_model import front_end as golden_front_end
from golden_model.config import (
    DETECTORS,
    MAX_FRAME_PX,
    EstimatorConfig,
    FrontEndConfig,
    MatcherConfig,
    check_choice,
    check_range,
)
from golden_model.feature import ilbp
from golden_model.formats import RESPONSE_CODE, encode_response
from golden_model.fuzzy.rules import MatchRules
from golden_model.fuzzy.sugeno import SugenoSystem
from golden_model.geometry.estimator import FrameMatches, estimate, homography_record
from golden_model.matching import correlation, rule_bases
from golden_model.matching.matcher import check_rule_base, match
from golden_model.pixel import fast, gray, half, harris, nms, smooth, sobel
from golden_model.records import MATCH
from hdl.blocks.chain import Chain, Descriptor
from hdl.blocks.flat import flat_values
from hdl.blocks.painting import make_painter
from hdl.blocks.vectors import (
    Block,
    Row,
    neighbours,
    of_stream,
    packet,
    padded_status,
    rows,
    sample_frames,
    sample_image,
    scan,
)
from hdl.build import Build, check_lanes
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

SMALL_FRAME_PX = 64
MATCHED_FRAME_PX = 160
"""Has some ninety features, twelve times as many as the matcher compares at once."""


@dataclass(frozen=True, kw_only=True)
class BlockConfig(FrontEndConfig):
    """What blocks are built from; the threshold, which none has built in, is that of the test benches."""

    levels: int = 1
    threshold: int = 1000
    max_features: int = 256
    width_px: int = Build.max_width_px
    """Longest line that a block accepts; the test benches send shorter ones."""
    pixels_per_clock: int = 1
    window_px: int = 3
    """Side of the window that is smoothed, 3 or 5."""
    lanes: int = 8
    rule_base: str | MatchRules = MatcherConfig.rule_base
    keep_above: int = MatcherConfig.keep_above

    def __post_init__(self) -> None:
        super().__post_init__()
        check_range("width_px", self.width_px, SMALL_FRAME_PX, MAX_FRAME_PX)
        check_choice("window_px", self.window_px, (3, 5))
        check_choice("pixels_per_clock", self.pixels_per_clock, (1, 2))
        check_lanes(self.lanes, self.max_features)


def _with_lines(
    config: BlockConfig, about: str, lines: int, blocks: Mapping[str, Any], answer: Callable[..., dict[str, Any]],
    *, margin_px: int, settings: Row | None = None, **others: Any,
) -> Block:  # fmt: skip
    """Blocks of which the first takes columns of pixels, behind the line memory that makes them."""
    rate = config.pixels_per_clock
    memory = LineBuffer(shape=8, lines=lines, width_px=config.width_px, pixels_per_clock=rate)
    lags = (getattr(block, name, 0) for block in blocks.values() for name in ("lag_px", "gradient_lag_px"))
    chain = Chain({"lines": memory, **blocks}, lag_px=sum(lags), **others)
    frames = [{"pixel": frame} for frame in sample_frames()]
    return scan(chain, about, frames, answer, margin_px=margin_px, settings=settings)


def _gray(config: BlockConfig) -> Block:
    frames = sample_frames()
    images = [np.stack([frames[n], frames[1 - n][::-1], frames[n][:, ::-1]], axis=-1) for n in (0, 1)]
    # Green in the lowest byte, then blue, red: the order of UG934.
    beats = [{"data": image.astype(int) @ (1 << 8, 1, 1 << 16)} for image in images]
    colours = iter(images)
    block, about = Gray(pixels_per_clock=config.pixels_per_clock), "Luma of RGB pixels, or gray pixels unchanged."
    return scan(block, about, beats, lambda data: {"pixel": gray.to_gray(next(colours))}, settings={"i_gray_input": 0})


def _half(config: BlockConfig) -> Block:
    block = Half(width_px=config.width_px, pixels_per_clock=config.pixels_per_clock)
    # The right pixel of a beat is in the line, too.
    frames = [{"pixel": frame[:, : 32 - block.pixels_per_clock]} for frame in sample_frames()]
    return scan(block, "Mean of each 2x2 pixels.", frames, lambda pixel: {"pixel": half.halve(pixel)},
        answered_per_clock=1)  # fmt: skip


def _smooth(config: BlockConfig) -> Block:
    side_px = config.window_px
    return _with_lines(
        config, f"Binomial smoothing, {side_px}x{side_px}.", side_px - 1,
        {"block": Binomial(window_px=side_px, pixels_per_clock=config.pixels_per_clock)},
        lambda pixel: {"pixel": smooth.binomial(pixel, side_px)}, margin_px=side_px // 2,
    )  # fmt: skip


def _sobel(config: BlockConfig) -> Block:
    return _with_lines(
        config, "Sobel gradients.", 2, {"block": Sobel(pixels_per_clock=config.pixels_per_clock)},
        lambda pixel: dict(zip(("gradient_x", "gradient_y"), sobel.gradients(pixel), strict=True)), margin_px=1,
    )  # fmt: skip


def _fast(config: BlockConfig) -> Block:
    return _with_lines(
        config, "FAST-9/16: segment test and score.", WINDOW_PX - 1,
        {"block": Fast(pixels_per_clock=config.pixels_per_clock)},
        lambda pixel: {"code": fast.response_code(pixel, 12)},
        margin_px=fast.MARGIN_PX, settings={"i_threshold_code": 12},
    )  # fmt: skip


def _response(config: BlockConfig, pixel: NDArray[np.uint8]) -> NDArray[np.uint16]:
    """The codes of a frame's responses."""
    if config.detector == "fast":
        return fast.response_code(pixel, config.threshold)
    smoothed = smooth.binomial(pixel, 3) if config.smoothed_gradients else pixel
    tensor = harris.structure_tensor(*sobel.gradients(smoothed), config.tensor_window_px)
    raw = harris.raw_response(*tensor, config.harris_k_numerator, config.harris_k_shift)
    return harris.response_code(raw, config.threshold)


def _settings(config: BlockConfig, *ports: str) -> Row:
    """What is set at run time, of the detector and its smallest code."""
    code = config.threshold if config.detector == "fast" else encode_response(np.array(config.threshold))
    values = {"i_fast": DETECTORS.index(config.detector), "i_threshold_code": int(code)}
    return {port: values[port] for port in ports}


def _harris(config: BlockConfig) -> Block:
    blocks = {
        "columns": GradientColumns(smoothed=config.smoothed_gradients, width_px=config.width_px),
        "tensor": StructureTensor(window_px=config.tensor_window_px),
        "raw": RawResponse(k_numerator=config.harris_k_numerator, k_shift=config.harris_k_shift),
        "code": ResponseCode(),
    }
    about = "Harris's corner response as a logarithmic code; 0 below the threshold."
    return _with_lines(
        config, about, 2, blocks, lambda pixel: {"code": _response(config, pixel)},
        margin_px=config.response_support_px, settings=_settings(config, "i_threshold_code"),
        fields={"column": "gradients"}, constants={"i_fast": 0},
    )  # fmt: skip


def _survivors(config: BlockConfig, code: NDArray[np.uint16]) -> dict[str, Any]:
    return {"code": nms.suppress(code, *config.suppression), **neighbours(code)}


def _nms(config: BlockConfig) -> Block:
    radius_px, rate = config.suppression_radius_px, config.pixels_per_clock
    # Equal ones, and the extremes: those of FAST have 8 bits.
    most = np.array([2, 6, 40, 256 if config.detector == "fast" else 1 << RESPONSE_CODE.bits])[np.arange(31) // 8]
    random = np.random.default_rng(4)
    frames = [{"code": random.integers(0, most, (27, 31)).astype(np.uint16)} for _ in range(2)]
    about = f"Non-maximum suppression in a window of {2 * radius_px + 1}x{2 * radius_px + 1} px."
    block = Suppression(radius_px=radius_px, width_px=config.width_px, pixels_per_clock=rate)
    return scan(block, about, frames, partial(_survivors, config), margin_px=radius_px,
        settings=_settings(config, "i_fast"))  # fmt: skip


def _corners(config: BlockConfig) -> Block:
    corners = Corners(config=config, width_px=config.width_px, pixels_per_clock=config.pixels_per_clock)
    about = "Harris or FAST corners after suppression, with the codes of the four neighbours."
    return _with_lines(
        config, about, 2, {"corners": corners}, lambda pixel: _survivors(config, _response(config, pixel)),
        margin_px=config.response_support_px + config.suppression_radius_px,
        settings=_settings(config, "i_fast", "i_threshold_code"),
    )  # fmt: skip


def _ilbp(config: BlockConfig) -> Block:
    pattern, size_px = config.pattern, 41
    scene = np.concatenate([sample_image(size_px, size_px, seed) for seed in range(24)])
    y, x = np.arange(24) * size_px + size_px // 2, np.full(24, size_px // 2)
    sectors, descriptors = ilbp.describe(scene, scene, x, y, pattern)
    rings = ilbp.gather(scene, x, y, [offset for ring in pattern.offsets for offset in ring]).T
    sent = [{"rings": ring.reshape(len(pattern.radii_px), -1).tolist()} for ring in rings]
    expected = [
        {"sector": sector, "descriptor": int.from_bytes(row.tobytes(), "little")}
        for sector, row in zip(sectors.tolist(), descriptors, strict=True)
    ]
    about = f"Orientation and descriptor ({pattern.name}) of the pixels on rings around a candidate."
    return of_stream(Descriptor(pattern=pattern), about, sent, expected)


def sugeno(system: SugenoSystem, value_bits: int, description: str, *, vectors: int) -> Block:
    """Make a block of a Sugeno system, with ``vectors`` at random, and those at the ends of its tables."""
    last = [each.entries - 1 for each in system.inputs]
    # The largest values lie beyond the tables, which then give their last degree.
    ends = [[0] * len(last), last, [(1 << value_bits) - 1] * len(last)]
    random = np.random.default_rng(5).integers(0, 1 << value_bits, (vectors, len(last)))
    inputs = np.vstack([ends, random])
    weights, chosen = system.evaluate(*inputs.T)
    expected = [{"weight": weight, "rule": rule} for weight, rule in np.stack([weights, chosen], 1).tolist()]
    return of_stream(Sugeno(system=system, value_bits=value_bits), description, inputs.tolist(), expected)


def _fuzzy(config: BlockConfig) -> Block:
    system = rule_bases.aerial_orientation(config.pattern.bits)
    names = ", ".join(variable.name for variable in system.inputs)
    about = f"Zero-order Sugeno system with the inputs {names}: weight (UQ0.8) and dominant rule."
    # 6 bits, because its tables are short: most values of 8 bits lie beyond them.
    return sugeno(system, 6, about, vectors=60)


def _correlation(_config: BlockConfig) -> Block:
    pairs = np.random.default_rng(6).integers(0, 256, (2, 30, 9)).astype(np.uint8)
    names = ("sad", "zssd", "ncc")
    scores = np.transpose([getattr(correlation, name)(*pairs) for name in names]).tolist()
    sent = [dict(zip(("left", "right"), pair, strict=True)) for pair in pairs.swapaxes(0, 1).tolist()]
    expected = [dict(zip(names, each, strict=True)) for each in scores]
    return of_stream(WindowCorrelation(), "SAD, ZSSD and NCC of two windows of 3x3 pixels.", sent, expected)


def _frames(config: BlockConfig) -> list[golden_front_end.FrameFeatures]:
    scene = sample_image(MATCHED_FRAME_PX, MATCHED_FRAME_PX + 8)
    views = (np.ascontiguousarray(scene[:, shift : shift + MATCHED_FRAME_PX]) for shift in (0, 8))
    return [golden_front_end.extract(view, config, frame=number) for number, view in enumerate(views)]


def _matcher(config: BlockConfig) -> Block:
    rules = MatcherConfig(rule_base=config.rule_base, keep_above=config.keep_above)
    check_rule_base(config.pattern, rules)
    pattern, frames = config.pattern, _frames(config)
    matches = match(frames[0].features, frames[1].features, pattern, rules)
    counts = {"matches": len(matches), "kept": int(np.count_nonzero(matches["verdict"]))}
    statuses = [padded_status(frame.status, frame.features.dtype.itemsize) for frame in frames]
    sent = [word for frame, status in zip(frames, statuses, strict=True) for word in packet(frame.features, status)]
    expected = packet(padded_status(frames[0].status, MATCH.record_bytes))
    expected += packet(matches, padded_status(frames[1].status, MATCH.record_bytes, **counts))
    return Block(
        Matcher(config=rules, pattern=pattern, lanes=config.lanes, max_features=config.max_features),
        "Mutual nearest neighbours by Hamming distance, weighed by fuzzy rules: feature packets in, match packets out.",
        {"i_features": rows("i_features", sent)},
        {"o_matches": rows("o_matches", expected)},
        dict.fromkeys(("i_estimating", "i_refused", "i_hold_reference", "i_take_reference"), 0)
        | {"i_keep_above": config.keep_above},
    )


def _homography(config: BlockConfig) -> Block:
    left, right = _frames(config)
    # A third of the matches, spread as all are; a fifth of them rejected, and none exactly where it should be.
    matches = match(left.features, right.features, config.pattern, MatcherConfig())[::3]
    random, settings = np.random.default_rng(8), EstimatorConfig(passes=1)
    matches["verdict"] = random.random(len(matches)) < 0.8
    for name in ("right_x", "right_y"):
        matches[name] += random.integers(0, 20, len(matches), np.uint16)
    result = estimate(FrameMatches.from_records(matches, right.status), settings)
    return Block(
        RecordEstimator(),
        "Estimates the homography of each frame's kept matches: packets of matches in, a packet of one record out for "
        "each.",
        {"i_matches": rows("i_matches", packet(matches, padded_status(right.status, MATCH.record_bytes)))},
        {"o": rows("o", packet(homography_record(result, frame=1)))},
        flat_values("i_settings", vars(settings)) | {"i_enable": 1, "i_clear": 0},
    )


class Entry(NamedTuple):
    """A block of the catalogue."""

    make: Callable[[BlockConfig], Block]
    settings: tuple[str, ...] = ()
    """The fields of the configuration on which it depends."""


WIDTH = ("width_px", "pixels_per_clock")
HARRIS = ("smoothed_gradients", "tensor_window_px", "harris_k_numerator", "harris_k_shift")
SUPPRESSED = ("suppression_radius_px", "detector")
CATALOGUE = {
    "gray": Entry(_gray, ("pixels_per_clock",)),
    "half": Entry(_half, WIDTH),
    "smooth": Entry(_smooth, (*WIDTH, "window_px")),
    "sobel": Entry(_sobel, WIDTH),
    "harris": Entry(_harris, ("width_px", *HARRIS)),
    "fast": Entry(_fast, WIDTH),
    "nms": Entry(_nms, (*WIDTH, *SUPPRESSED)),
    "corners": Entry(_corners, (*WIDTH, *HARRIS, *SUPPRESSED, "threshold")),
    "ilbp": Entry(_ilbp, ("descriptor",)),
    "fuzzy": Entry(_fuzzy),
    "correlation": Entry(_correlation),
    "matcher": Entry(_matcher, ("lanes", "max_features", "descriptor", "rule_base", "keep_above")),
    "homography": Entry(_homography),
    "painter": Entry(lambda _: make_painter()),
}
"""The blocks by name."""


def make_block(name: str, settings: Mapping[str, Any]) -> Block:
    """Make a block of the catalogue with values of `BlockConfig`, which may be texts.

    Raises
    ------
    ValueError
        For an unknown block, name or value, naming the valid ones.
    """
    if name not in CATALOGUE:
        raise ValueError(f"unknown block {name!r}; valid: {', '.join(CATALOGUE)}, or MODULE:CLASS of your own")
    make, known = CATALOGUE[name]
    if unknown := next((key for key in settings if key not in known), ""):
        raise ValueError(f"{name} does not depend on {unknown!r}; valid: {', '.join(known) or 'none'}")
    usual = {"threshold": 12} if settings.get("detector") == "fast" else {}  # its scores are gray levels
    try:
        config = BlockConfig(**usual | {key: _read_value(value) for key, value in settings.items()})
        return replace(make(config), parameters={key: getattr(config, key) for key in known})
    except ValueError as error:
        # Elsewhere names in backquotes are those of options.
        raise ValueError(str(error).replace("`", "")) from None


def _read_value(value: Any) -> Any:
    """The number or truth value that a text is; the configuration refuses other texts."""
    words = {"true": True, "false": False}
    return value if type(value) is not str else int(value) if value.isdecimal() else words.get(value, value)
