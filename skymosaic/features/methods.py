"""Valid combinations of detector and descriptor, and a host backend that computes them.

Harris and FAST with an ILBP descriptor run on the accelerator, so every backend computes them. All other combinations
are computed here, behind the same interface, `sim.backends.interface.Backend`.
"""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from golden_model.arrays import Pixels, Records
from golden_model.config import PRESETS, Config, FrontEndConfig
from golden_model.feature.ilbp import PATTERNS
from golden_model.front_end import extract
from golden_model.fuzzy.sugeno import SugenoSystem
from golden_model.matching import matcher, rule_bases
from golden_model.pixel.gray import to_gray
from golden_model.records import FRAME_STATUS, MATCH, Tag
from sim.backends.interface import Backend, FrameResult, Reference
from skymosaic.common.errors import InputError
from skymosaic.features import detectors, matchers
from skymosaic.features.descriptors import ANGLE_IGNORED, DESCRIPTORS, TRACKED, WINDOWS_PX, describe
from skymosaic.features.detectors import DETECTORS, FRONT_END_DETECTORS

FAST_THRESHOLD = 10
"""FAST's threshold in gray levels; that of a Harris configuration has another unit."""
MAX_BORDER_PX = 255
GIVEN = "given"
"""Detector and descriptor of matches that the user has given."""
USUAL_DETECTOR = {name: name for name in DETECTORS} | {"freak": "brisk"}
"""The detector for a descriptor if none is named; other descriptors get the configuration's detector."""


@dataclass(frozen=True)
class Method:
    """Detector and descriptor, by their names in `DETECTORS` and `DESCRIPTORS`."""

    detector: str
    descriptor: str

    @property
    def on_accelerator(self) -> bool:
        """Whether the accelerator, and so every backend, computes it."""
        return self.detector in FRONT_END_DETECTORS and self.descriptor in PATTERNS

    def rules(self, config: Config) -> SugenoSystem | None:
        """The fuzzy system that weighs matches; None where another check decides."""
        if self.descriptor in WINDOWS_PX:
            return rule_bases.correlation()
        pattern, rules = PATTERNS.get(self.descriptor), config.matcher.rules
        return rules.tables(pattern.bits) if pattern and rules else None

    def rule_names(self, config: Config) -> Sequence[str]:
        """The meaning of each value of a match record's ``rule``."""
        if self.descriptor == GIVEN:
            return ("as given",)
        if self.descriptor == TRACKED:
            return matchers.TRACKING_RULES
        if self.descriptor in WINDOWS_PX:
            return matcher.describe_rules(rule_bases.correlation())
        if self.on_accelerator or config.matcher.rule_base != "none":
            return matcher.rule_names(PATTERNS[self.descriptor], config.matcher)
        return matchers.RATIO_RULES


def choose_method(config: Config, detector: str | None = None, descriptor: str | None = None) -> tuple[Method, Config]:
    """Complete a choice of detector and descriptor, and adapt the configuration to it.

    The configuration supplies what is not named: None is the one that goes with the other, or its own. Its rule base
    decides on matches of ILBP descriptors; with "none", the ratio test does on the host, and nothing on the
    accelerator. All other matches are decided by the ratio test, fuzzy correlation or the tracker.

    Returns
    -------
    method : Method
    config : Config
        With the method's detector, descriptor, threshold and border.

    Raises
    ------
    InputError
        For an impossible combination, with the reason.
    """
    own = config.front_end
    if detector is None:
        detector = USUAL_DETECTOR.get(descriptor or "", own.detector)
    if descriptor is None:
        descriptor = detector if detector in DESCRIPTORS else own.descriptor
    if descriptor == "akaze" and detector != "akaze":
        raise InputError(
            f"the akaze descriptor needs akaze's own scale space and cannot describe key points of {detector}; "
            "use `detector` akaze"
        )
    if descriptor in PATTERNS:
        try:
            matcher.check_rule_base(PATTERNS[descriptor], config.matcher)
        except ValueError as error:
            raise InputError(str(error)) from None
    else:
        # Rule bases are made for the bits and regions of ILBP.
        config = dataclasses.replace(config, matcher=dataclasses.replace(config.matcher, rule_base="none"))
    method = Method(detector, descriptor)
    return method, dataclasses.replace(config, front_end=_front_end(config, method))


@dataclass(frozen=True, eq=False)
class _Frame:
    gray: Pixels
    features: Records
    good: bool


@dataclass(frozen=True)
class HostBackend(Backend):
    """Computes any method on the host, with the golden model's corners and rules and OpenCV's other algorithms.

    OpenCV's and SURF's key points are limited to the ``max_features`` strongest.
    """

    method: Method

    def run(
        self, frames: Sequence[NDArray[np.uint8]], config: Config, *, reference: Reference = "held"
    ) -> list[FrameResult]:
        """See `sim.backends.interface.Backend.run`."""
        results: list[FrameResult] = []
        references: matcher.ReferenceFrame[_Frame] = matcher.ReferenceFrame()
        for number, image in enumerate(frames):
            right, status = self._frame(image, config.front_end, number)
            left = references.for_frame(right, good=right.good, held=reference == "held")
            features, matches = right.features, np.zeros(0, MATCH.dtype)
            if left is not None:
                features, matches = self._match(left, right, config)
            results.append(FrameResult.count_matches(features, matches, status))
        return results

    def _frame(self, image: Pixels, config: FrontEndConfig, number: int) -> tuple[_Frame, np.void]:
        gray = to_gray(image)
        detector, descriptor = self.method.detector, self.method.descriptor
        if detector in FRONT_END_DETECTORS:
            corners = extract(image, config, frame=number)
            status, key_points = corners.status, detectors.to_key_points(corners.features)
        else:
            status = _status(gray, number)
            key_points = detectors.detect(gray, detector, config.max_features)
            if descriptor in ANGLE_IGNORED:
                key_points = detectors.keep_one_per_position(key_points)
            key_points = key_points[: config.max_features]
            if detector != descriptor:
                key_points = detectors.strip_octaves(key_points)
        features = describe(gray, key_points, descriptor)
        features["frame"] = number
        status["features"] = len(features)
        return _Frame(gray, features, bool(status["good"])), status

    def _match(self, left: _Frame, right: _Frame, config: Config) -> tuple[Records, Records]:
        """Match; returns the right features, to which a tracker adds its own, and the matches."""
        descriptor = self.method.descriptor
        if descriptor == TRACKED:
            return matchers.track_features(left.gray, right.gray, left.features, right.features)
        pair = left.features, right.features
        if descriptor in WINDOWS_PX:
            return right.features, matchers.match_by_correlation(*pair)
        if config.matcher.rule_base != "none":
            return right.features, matcher.match(*pair, PATTERNS[descriptor], config.matcher)
        norm = cv2.NORM_L2 if descriptor == "sift" else cv2.NORM_HAMMING
        return right.features, matchers.match_by_ratio(*pair, norm)


def _status(gray: Pixels, number: int) -> np.void:
    status = np.zeros(1, FRAME_STATUS.dtype)
    status["tag"], status["good"], status["frame"] = Tag.FRAME_STATUS, 1, number
    status["height"], status["width"] = gray.shape
    record: np.void = status[0]
    return record


def _front_end(config: Config, method: Method) -> FrontEndConfig:
    """The configuration's front end with the method's detector and descriptor, and the border that they need."""
    own = config.front_end
    detector = method.detector if method.detector in FRONT_END_DETECTORS else own.detector
    descriptor = method.descriptor if method.descriptor in PATTERNS else own.descriptor
    threshold = own.threshold
    if detector != own.detector:
        threshold = FAST_THRESHOLD if detector == "fast" else PRESETS[config.preset].front_end.threshold
    # A configuration is refused if its border is too small for detector and descriptor. So these are changed first,
    # under the largest border.
    changed = dataclasses.replace(
        own, detector=detector, descriptor=descriptor, threshold=threshold, border_px=MAX_BORDER_PX
    )
    return dataclasses.replace(changed, border_px=max(own.border_px, changed.min_border_px))
