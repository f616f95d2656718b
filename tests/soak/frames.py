"""Frames for `tests.soak.soak`: settings, pixels, flaws, and the expected results."""

import dataclasses
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from golden_model.arrays import Pixels, Records
from golden_model.config import CELL_SIZES_PX, DETECTORS, MAX_PER_CELL, PRESETS, Config
from golden_model.front_end import extract
from golden_model.matching.matcher import ReferenceFrame, match
from golden_model.records import MATCH, Cause
from hdl.build import Build
from hdl.settings import RUNNING, matched_frame_settings
from sim.backends.interface import FrameResult
from sim.simulators.recording import END_OF_LINE, flatten_frame

BUILT_PX, MAX_FEATURES = 128, 256
"""A small build simulates fast, and small frames are many."""
CONFIG = dataclasses.replace(
    PRESETS["aerial"], front_end=dataclasses.replace(PRESETS["aerial"].front_end, max_features=MAX_FEATURES)
)
BUILD = Build(config=CONFIG, lanes=4, max_width_px=BUILT_PX, max_height_px=BUILT_PX)
TOO_LARGE = {"width_px": BUILT_PX + 2, "height_px": 4000, "cell_log2": 9, "per_cell": 0}
"""Settings that are out of range, or beyond what was built."""
FLAWS = (Cause.SHORT_LINE, Cause.LONG_LINE, Cause.EARLY_END, Cause.MISSING_START)
FLAW_SHARE, INVALID_SHARE, MEMORY_SHARE = 0.15, 0.05, 0.2
TEXTURE_PX = 400
MIN_SPLIT_BEATS = 200


@dataclass(frozen=True, eq=False)
class SentFrame:
    """Beats, and what must come of them: a golden result, or a bad status with a cause."""

    number: int
    data: NDArray[np.uint64]
    flags: Pixels
    size_px: tuple[int, int]
    golden: FrameResult | None
    cause: Cause

    @property
    def can_be_split(self) -> bool:
        """Whether settings may be written in its middle: it has started by then, and has not ended."""
        is_short = self.cause in {Cause.MISSING_START, Cause.INVALID_SETTINGS} or len(self.data) < MIN_SPLIT_BEATS
        return not is_short


class Source:
    """Random episodes: frames under one setting, one after the other; their numbers and references go on."""

    def __init__(self, rng: np.random.Generator) -> None:
        self._rng = rng
        noise = rng.integers(0, 256, (TEXTURE_PX, TEXTURE_PX)).astype(np.float32)
        smooth = cv2.GaussianBlur(noise, (0, 0), 1.5)
        self._texture = cv2.normalize(smooth, smooth, 0, 255, cv2.NORM_MINMAX).astype(np.uint8)
        self._corner = np.array([100, 100])
        self.start_over(set())

    def start_over(self, other_sizes: set[tuple[int, int]]) -> None:
        """After a reset or a clear; the next frames have none of these sizes."""
        self._number = 0
        self._references: ReferenceFrame[Records] = ReferenceFrame()
        self._other_sizes = other_sizes

    def episode(self) -> tuple[dict[str, int], list[SentFrame]]:
        """Settings, and the frames to send with them."""
        rng = self._rng
        config, size_px = self._config(), self._size()
        is_gray, memory, hold = rng.random() < 0.5, int(rng.random() < MEMORY_SHARE), int(rng.random() < 0.5)
        values = matched_frame_settings(config, *size_px, gray_input=is_gray)
        values |= {**RUNNING, "memory_mode": memory, "hold_reference": hold}
        is_invalid = rng.random() < INVALID_SHARE
        if is_invalid:
            name = str(rng.choice(list(TOO_LARGE)))
            values[name] = TOO_LARGE[name]
            size_px = values["width_px"], values["height_px"]
        frames: list[SentFrame] = []
        for left in reversed(range(rng.integers(1, 5))):
            image = self._image(size_px if not is_invalid else (64, 64), is_gray=is_gray)
            flaw = Cause.INVALID_SETTINGS if is_invalid else self._flaw(frames, memory=memory, is_last=not left)
            if flaw:
                frames.append(self._bad(image, size_px, flaw, memory=memory))
            else:
                frames.append(self._good(image, config, memory=memory, hold=hold))
        return values, frames

    def _size(self) -> tuple[int, int]:
        while True:
            width_px, height_px = self._rng.integers(64, BUILT_PX + 1, 2).tolist()
            if (width_px, height_px) not in self._other_sizes:
                return width_px, height_px

    def _config(self) -> Config:
        rng = self._rng
        detector = str(rng.choice(DETECTORS, p=[0.7, 0.3]))
        front_end = dataclasses.replace(
            CONFIG.front_end,
            detector=detector,
            threshold=int(10 ** rng.uniform(0, 7)) if detector == "harris" else int(rng.integers(1, 80)),
            cell_px=int(rng.choice(CELL_SIZES_PX)),
            per_cell=int(rng.integers(1, MAX_PER_CELL + 1)),
        )
        matcher = dataclasses.replace(CONFIG.matcher, keep_above=int(rng.integers(256)))
        return dataclasses.replace(CONFIG, front_end=front_end, matcher=matcher)

    def _image(self, size_px: tuple[int, int], *, is_gray: bool) -> Pixels:
        """Mostly a view that wanders over a texture, so that there are matches; else noise, steps or nothing."""
        rng, (width_px, height_px) = self._rng, size_px
        kind = rng.choice(["view", "noise", "steps", "flat"], p=[0.7, 0.1, 0.1, 0.1])
        shape = (height_px, width_px) if is_gray else (height_px, width_px, 3)
        if kind == "noise":
            return rng.integers(0, 256, shape, np.uint8)
        if kind == "flat":
            return np.full(shape, rng.integers(256), np.uint8)
        if kind == "steps":
            y, x = np.indices(shape[:2])
            steps = ((x // rng.integers(1, 12) + y // rng.integers(1, 12)) % 2 * rng.integers(1, 256)).astype(np.uint8)
            return steps if is_gray else np.repeat(steps[..., np.newaxis], 3, axis=2)
        self._corner = np.clip(self._corner + rng.integers(-6, 7, 2), 0, TEXTURE_PX - BUILT_PX - 8)
        views = [
            self._texture[top : top + height_px, left : left + width_px]
            for top, left in (self._corner + 3 * channel for channel in range(1 if is_gray else 3))
        ]
        return np.ascontiguousarray(views[0] if is_gray else np.stack(views, axis=-1))

    def _good(self, image: Pixels, config: Config, *, memory: int, hold: int) -> SentFrame:
        data, flags = _beats(image, memory=memory)
        frame = extract(image, config.front_end, frame=self._number)
        reference = self._references.for_frame(frame.features, good=True, held=bool(hold))
        matches = np.zeros(0, MATCH.dtype)
        if reference is not None:
            matches = match(reference, frame.features, config.front_end.pattern, config.matcher)
        result = FrameResult.count_matches(frame.features, matches, frame.status)
        return self._numbered(data, flags, (image.shape[1], image.shape[0]), result, Cause(0))

    def _flaw(self, before: list[SentFrame], *, memory: int, is_last: bool) -> Cause:
        """Mostly none; else one that has a definite outcome after the frames before."""
        if self._rng.random() > FLAW_SHARE:
            return Cause(0)
        if memory:
            return Cause.EARLY_END
        flaw = Cause(int(self._rng.choice(FLAWS)))
        # Stray pixels are reported only after a good frame, and a frame that is cut off ends when the next one starts.
        is_vague = is_last if flaw == Cause.EARLY_END else flaw == Cause.MISSING_START and not _ends_good(before)
        return Cause(0) if is_vague else flaw

    def _bad(self, image: Pixels, size_px: tuple[int, int], cause: Cause, *, memory: int) -> SentFrame:
        data, flags = _beats(image, memory=memory)
        width_px = image.shape[1]
        row, column = self._rng.integers(0, [image.shape[0], width_px - 1]).tolist()
        end = (row + 1) * width_px - 1
        if cause == Cause.SHORT_LINE:
            flags[end - 1 - column] |= END_OF_LINE
        elif cause == Cause.LONG_LINE:
            flags[end] &= ~np.uint8(END_OF_LINE)
        elif cause == Cause.EARLY_END:
            beats = int(self._rng.integers(1, len(data)))
            data, flags = data[:beats], flags[:beats]
            flags[-1] |= END_OF_LINE * memory
        elif cause == Cause.MISSING_START:
            beats = int(self._rng.integers(1, len(data)))
            data, flags = data[1 : beats + 1], flags[1 : beats + 1]
        return self._numbered(data, flags, size_px, None, cause)

    def _numbered(
        self,
        data: NDArray[np.uint64],
        flags: Pixels,
        size_px: tuple[int, int],
        golden: FrameResult | None,
        cause: Cause,
    ) -> SentFrame:
        self._number += 1
        return SentFrame(self._number - 1, data, flags, size_px, golden, cause)


def _ends_good(frames: list[SentFrame]) -> bool:
    return bool(frames) and frames[-1].golden is not None


def _beats(image: Pixels, *, memory: int) -> tuple[NDArray[np.uint64], Pixels]:
    """Beats of video; or of a transfer from memory: four gray pixels, or red, green and blue; its end is marked."""
    if not memory:
        return flatten_frame(image)
    if image.ndim == 2:
        data = np.pad(image.ravel(), (0, -image.size % 4)).view("<u4").astype(np.uint64)
    else:
        blue, green, red = np.moveaxis(image.astype(np.uint64), -1, 0)
        data = (red | green << 8 | blue << 16).ravel()
    flags = np.zeros(data.shape, np.uint8)
    flags[-1] = END_OF_LINE
    return data, flags
