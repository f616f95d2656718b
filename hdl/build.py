"""What is decided when an accelerator is built: immutable, validated, with named builds.

Nothing here imports Amaranth, because the host imports this module and must start without it.
"""

from dataclasses import dataclass, replace
from typing import Literal

from golden_model.config import MAX_FRAME_PX, MIN_FRAME_PX, PRESETS, Config, FrontEndConfig, check_choice, check_range
from golden_model.matching.matcher import check_rule_base
from golden_model.records import HOMOGRAPHY, MATCH, WORD_BYTES

Shell = Literal["streams", "camera", "serial"]
VIDEO_BITS: dict[Shell, tuple[int, ...]] = {"streams": (32, 24, 8, 48, 16), "camera": (24, 8), "serial": (8,)}
"""Widths of the video input that each shell takes: 24 and 8 for RGB and gray (UG934), 48 and 16 for two pixels per
clock, 32 for the words of a DMA."""
MAX_SERIAL_PX = 208 * 2048 - 64
"""Pixels that wait behind a serial port: bytes in all block RAMs of the ULX3S, without those for commands."""
LANES = (2, 4, 8, 16, 32, 64, 128)


def check_lanes(lanes: int, max_features: int) -> None:
    """Raise ValueError unless the matcher can have so many lanes."""
    check_choice("`lanes`", lanes, tuple(each for each in LANES if each <= max_features))


def pixels_per_clock(video_bits: int) -> int:
    """Pixels in a beat of a video input, or ValueError for a width that no input has."""
    check_choice("video_bits", video_bits, VIDEO_BITS["streams"])
    return 2 if video_bits in {48, 16} else 1


@dataclass(frozen=True, kw_only=True)
class Build:
    """Everything that an accelerator is built from; all else are registers.

    Raises
    ------
    ValueError
        For an impossible value or combination; the message names the valid ones.
    """

    config: Config = PRESETS["aerial"]
    """What is built. Detector, threshold, cells, the limit of the weight and the estimator's numbers are registers
    instead. With an estimator, there are homographies."""
    lanes: int = 16
    """Left descriptors compared at a time, one of `LANES`."""
    max_width_px: int = 1920
    max_height_px: int = 1080
    """Largest frame, 64 to 4096."""
    video_bits: int = 32
    """Width of the video input's data, one of `VIDEO_BITS`; 48 and 16 bring two pixels per clock."""
    shell: Shell = "streams"
    """What surrounds the accelerator: nothing, so that its ports are AXI4-Streams for DMAs; a camera's clock and rings
    in memory (`hdl.shell`); or a serial port (`hdl.serial`)."""
    painter: bool = False
    """Whether a camera's frames are painted onto a canvas in memory (`hdl.painting`), where homographies say."""

    def __post_init__(self) -> None:
        self.validate()

    def validate(self) -> None:
        """Raise ValueError for what cannot be built."""
        check_range("`max_width_px`", self.max_width_px, MIN_FRAME_PX, MAX_FRAME_PX)
        check_range("`max_height_px`", self.max_height_px, MIN_FRAME_PX, MAX_FRAME_PX)
        check_lanes(self.lanes, self.config.front_end.max_features)
        check_rule_base(self.config.front_end.pattern, self.config.matcher)
        check_choice("shell", self.shell, tuple(VIDEO_BITS))
        check_choice(f"`video_bits` with shell {self.shell!r}", self.video_bits, VIDEO_BITS[self.shell])
        area_px = self.max_width_px * self.max_height_px
        if self.shell == "serial" and area_px > MAX_SERIAL_PX:
            raise ValueError(
                f"`max_width_px` times `max_height_px` is {area_px:,}; with shell 'serial' a whole frame waits in the "
                f"board's block RAM, which holds {MAX_SERIAL_PX:,} at most"
            )
        needed_px = self.config.front_end.min_hardware_border_px(self.pixels_per_clock)
        if self.config.front_end.border_px < needed_px:
            raise ValueError(
                f"border_px is {self.config.front_end.border_px}; with this detector and descriptor the hardware needs "
                f"{needed_px}"
            )
        if self.painter and (self.shell != "camera" or self.config.estimator is None):
            raise ValueError("painter needs the shell 'camera' and an estimator")

    @property
    def pixels_per_clock(self) -> int:
        """Pixels in a beat of video."""
        return pixels_per_clock(self.video_bits)

    @property
    def outputs(self) -> tuple[str, ...]:
        """The outputs, as registers, ports and DMAs name them."""
        return ("features", "matches", *(("homographies",) if self.config.estimator else ()))

    @property
    def record_words(self) -> dict[str, int]:
        """Words of 64 bits in a record of each output."""
        records = {"features": self.config.front_end.pattern.record, "matches": MATCH, "homographies": HOMOGRAPHY}
        return {output: records[output].record_bytes // WORD_BYTES for output in self.outputs}


BUILDS = {
    "pynq_z2": Build(),
    "camera": Build(video_bits=24, shell="camera"),
    # One level and small banks, to need less logic.
    "ulx3s": Build(
        config=Config(front_end=FrontEndConfig(levels=1, max_features=1024)),
        lanes=4,
        max_width_px=320,
        max_height_px=240,
        video_bits=8,
        shell="serial",
    ),
    "tiny": Build(
        config=replace(PRESETS["thesis"], front_end=replace(PRESETS["thesis"].front_end, max_features=64)),
        lanes=2,
        max_width_px=128,
        max_height_px=128,
    ),
}
"""The named builds: of a board, of a camera, and `tiny` for tests. A board that is not named here has ``Build()``."""
