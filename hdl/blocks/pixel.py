# amaranth: UnusedElaboratable=no
# What is made and not elaborated would warn whoever refuses it, or looks at its vectors alone.
"""Rows of the pixel blocks: what each is made of for a configuration, two frames, and what the golden model answers."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from golden_model.config import DETECTORS, MAX_FRAME_PX, FrontEndConfig, MatcherConfig, check_choice, check_range
from golden_model.formats import RESPONSE_CODE, encode_response
from golden_model.fuzzy.rules import MatchRules
from golden_model.pixel import fast, gray, half, harris, nms, smooth, sobel
from hdl.blocks.chain import Chain
from hdl.blocks.vectors import Block, Row, neighbours, sample_frames, scan
from hdl.build import VIDEO_BITS, Build, check_lanes
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
    video_bits: int = Build.video_bits

    def __post_init__(self) -> None:
        super().__post_init__()
        check_range("width_px", self.width_px, SMALL_FRAME_PX, MAX_FRAME_PX)
        check_choice("window_px", self.window_px, (3, 5))
        check_choice("pixels_per_clock", self.pixels_per_clock, (1, 2))
        check_choice("video_bits", self.video_bits, VIDEO_BITS["streams"])
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


class Entry(NamedTuple):
    """A block of the catalogue."""

    make: Callable[[BlockConfig], Block]
    settings: tuple[str, ...] = ()
    """The fields of the configuration on which it depends."""


WIDTH = ("width_px", "pixels_per_clock")
HARRIS = ("smoothed_gradients", "tensor_window_px", "harris_k_numerator", "harris_k_shift")
SUPPRESSED = ("suppression_radius_px", "detector")
PIXEL_BLOCKS = {
    "gray": Entry(_gray, ("pixels_per_clock",)),
    "half": Entry(_half, WIDTH),
    "smooth": Entry(_smooth, (*WIDTH, "window_px")),
    "sobel": Entry(_sobel, WIDTH),
    "harris": Entry(_harris, ("width_px", *HARRIS)),
    "fast": Entry(_fast, WIDTH),
    "nms": Entry(_nms, (*WIDTH, *SUPPRESSED)),
    "corners": Entry(_corners, (*WIDTH, *HARRIS, *SUPPRESSED, "threshold")),
}
