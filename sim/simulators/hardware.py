"""The simulated accelerator as a `sim.backends.interface.Backend`."""

import dataclasses
import itertools
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from golden_model.arrays import Pixels
from golden_model.config import Config
from golden_model.geometry.estimator import MAX_CYCLES
from golden_model.records import FRAME_STATUS, HOMOGRAPHY, MATCH, WORD_BYTES, Record
from hdl.registers.register_map import register_writes
from hdl.registers.shell_register_map import ALL_REGISTERS
from hdl.settings import RUNNING, estimator_settings, matched_frame_settings
from sim.backends.errors import BackendError
from sim.backends.interface import Backend, FrameClocks, FrameResult, Mismatch, Progress, Reference
from sim.simulators.accelerator_designs import FEATURES, HOMOGRAPHIES, MATCHES, choose_build, design_accelerator
from sim.simulators.recording import Recording, Segment, flatten_frame
from sim.simulators.stages import locate_mismatch
from sim.simulators.verilator import simulate


class HardwareBackend(Backend):
    """Features, matches and homographies computed by the simulated accelerator, whose runs may write a VCD file."""

    def __init__(self, *, progress: Progress, waves: Path | None):
        self._progress = progress
        self._waves = waves

    def run(self, frames: Sequence[Pixels], config: Config, *, reference: Reference = "held") -> list[FrameResult]:
        """See `sim.backends.interface.Backend.run`; a configuration that is not for hardware is a `BackendError`."""
        segments = make_segments(frames, config, reference)
        try:
            build = choose_build(config, frames)
        # As of a border that is too narrow.
        except ValueError as error:
            raise BackendError(f"the hardware cannot be built: {error}") from None
        recordings = simulate(design_accelerator(build), segments, progress=self._progress, waves=self._waves)
        return decode_recordings(recordings, config)

    def locate(self, image: Pixels, config: Config, *, frame: int) -> Mismatch | None:
        """See `sim.backends.interface.Backend.locate`; the first call builds a front end that outputs its stages."""
        self._progress("looking for the first stage that differs")
        return locate_mismatch(image, config.front_end, frame=frame, progress=self._progress)


def make_segments(frames: Sequence[Pixels], config: Config, reference: Reference) -> list[Segment]:
    """Frames as segments for the accelerator; consecutive frames of one shape share a segment and follow without a gap.

    Raises
    ------
    ValueError
        For a frame that the configuration cannot process.
    """
    groups = [list(group) for _, group in itertools.groupby(frames, key=lambda image: image.shape)]
    return [_make_segment(group, config, reference, first=number == 0) for number, group in enumerate(groups)]


def _make_segment(frames: list[Pixels], config: Config, reference: Reference, *, first: bool) -> Segment:
    height_px, width_px = frames[0].shape[:2]
    data, flags = (np.concatenate(parts) for parts in zip(*map(flatten_frame, frames), strict=True))
    held = int(reference == "held")
    values = {
        **matched_frame_settings(config, width_px, height_px, gray_input=frames[0].ndim == 2),
        **RUNNING,
        "hold_reference": held,
        **({"take_reference": held} if first else {}),
        **estimator_settings(config),
    }
    # A frame takes a clock for each pixel, and its matching at most as long again; a design that takes twice as long
    # hangs.
    cycle_limit = 2 * data.size + len(frames) * (config.front_end.max_features**2 + MAX_CYCLES)
    writes = register_writes(values, registers=ALL_REGISTERS)
    return Segment(data, flags, len(frames), cycle_limit, writes=writes)


def decode_recordings(recordings: Sequence[Recording], config: Config) -> list[FrameResult]:
    """The frames of segments that ran one after the other."""
    return [frame for segment, recording in enumerate(recordings) for frame in _decode(recording, config, segment)]


def _decode(recording: Recording, config: Config, segment: int) -> Iterator[FrameResult]:
    features, matches = recording.outputs[FEATURES], recording.outputs[MATCHES]
    ends = zip(recording.starts, features.ends[:, 1], matches.ends[:, 1], strict=True)
    packets = zip(ends, features.packets, matches.packets, strict=True)
    homographies = recording.outputs.get(HOMOGRAPHIES)
    for number, ((start, features_end, matches_end), feature_words, match_words) in enumerate(packets):
        clocks = FrameClocks(segment, int(start), int(features_end), int(matches_end))
        frame = decode_frame(feature_words, match_words, config)
        if homographies:
            clocks = dataclasses.replace(clocks, homography_end=int(homographies.ends[number, 1]))
            frame = dataclasses.replace(frame, homography=homographies.packets[number].view(HOMOGRAPHY.dtype)[0])
        cycles = clocks.features_end - clocks.first_pixel + 1
        yield dataclasses.replace(frame, cycles=cycles, clocks=clocks)


def decode_frame(feature_words: NDArray[np.uint64], match_words: NDArray[np.uint64], config: Config) -> FrameResult:
    """Decode the two packets of a frame; each consists of records and a FrameStatus."""
    pattern = config.front_end.pattern
    feature = pattern.record
    return FrameResult(
        features=feature_words.view(feature.dtype)[:-1],
        matches=match_words.view(MATCH.dtype)[:-1],
        status=decode_status(feature, feature_words),
        match_status=decode_status(MATCH, match_words),
    )


def decode_status(record: Record, words: NDArray[np.uint64]) -> np.void:
    """The FrameStatus at the end of a packet of ``record``; it is as long as one of them."""
    last = words[-record.record_bytes // WORD_BYTES :]
    status: np.void = last[: FRAME_STATUS.record_bytes // WORD_BYTES].view(FRAME_STATUS.dtype)[0]
    return status
