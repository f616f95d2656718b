"""The methods that register a pair in `bench.registration`: the project's own efforts, the chip, and OpenCV's."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import typer

from bench.peers import METHODS, register_by_peer
from bench.rendered_pairs import ReliefPair
from golden_model.arrays import Matrix, Pixels
from golden_model.config import EstimatorConfig
from golden_model.geometry.estimator import Estimate, FrameMatches, estimate
from skymosaic import extract, register
from skymosaic.evaluation.known_pairs import KnownPair
from skymosaic.features.backends import load_backend
from skymosaic.geometry.fabric import in_pixels
from skymosaic.imagery.images import load
from skymosaic.registration.extraction import extract_within_capacity
from skymosaic.registration.options import RegistrationOptions

FEW_FEATURES, MANY_FEATURES = 1000, 8000
OURS: dict[str, tuple[str, dict[str, Any]]] = {
    "normal": ("skymosaic", {}),
    "fast": ("skymosaic, `--effort fast`", {"effort": "fast"}),
    "thorough": ("skymosaic, `--effort thorough`", {"effort": "thorough"}),
    "fast-corners": ("skymosaic, FAST corners", {"detector": "fast"}),
    "thesis": ("skymosaic, preset `thesis`", {"preset": "thesis"}),
}
"""What ``--method`` names: the row's heading, and the options of `skymosaic.register` behind it."""
ON_CHIP = "on the chip alone"
REFERENCE = f"SIFT, {FEW_FEATURES} features"
"""The row whose processor time is 1."""

Method = Callable[[KnownPair | ReliefPair, int], Iterator[Matrix | None]]
"""Takes a pair and the number of seeds; yields the homography of each seed."""


def chosen_methods(wanted: list[str] | None) -> dict[str, Method]:
    """The methods to run, by the heading of their row; ``wanted`` are names of methods (None: all)."""
    named = {name: {heading: ours(**options)} for name, (heading, options) in OURS.items()}
    named["chip"] = {ON_CHIP: chip}
    named |= {name: {f"{title}, {FEW_FEATURES} features": peer(name, FEW_FEATURES)} for name, title in METHODS.items()}
    named["sift"] |= {f"SIFT, {MANY_FEATURES}": peer("sift", MANY_FEATURES)}
    named["rootsift"] = {f"RootSIFT, {MANY_FEATURES}": peer("rootsift", MANY_FEATURES)}
    if unknown := [name for name in wanted or () if name not in named]:
        raise typer.BadParameter(f"no method {', '.join(unknown)}; valid: {', '.join(named)}")
    return {heading: run for name in wanted or named for heading, run in named[name].items()}


def ours(**options: Any) -> Method:
    """The project's own registration; its features serve all seeds."""

    def run(pair: KnownPair | ReliefPair, seeds: int) -> Iterator[Matrix | None]:
        is_shared = "detector" not in options and "preset" not in options
        left, right = (extract(side) if is_shared else side for side in (pair.left, pair.right))
        for seed in range(seeds):
            yield register(left, right, seed=seed, **options).homography

    return run


def chip(pair: KnownPair | ReliefPair, seeds: int) -> Iterator[Matrix | None]:
    """Front end, matcher and estimator of the hardware, with nothing of the host's."""
    for result in estimate_on_chip(load(pair.left).pixels, load(pair.right).pixels, seeds):
        yield None if result.causes else in_pixels(result.homography)


def estimate_on_chip(left: Pixels, right: Pixels, seeds: int = 1) -> Iterator[Estimate]:
    """The golden model of the whole chip, for a pair of images and each seed."""
    _, config = RegistrationOptions().choose_method()
    (_, result), _ = extract_within_capacity(load_backend("golden"), [left, right], config)
    matches = FrameMatches.from_records(result.matches, result.status)
    for seed in range(seeds):
        yield estimate(matches, EstimatorConfig(seed=EstimatorConfig().seed + seed))


def peer(name: str, count: int) -> Method:
    """An OpenCV method on the same files; its seed is fixed."""

    def run(pair: KnownPair | ReliefPair, _seeds: int) -> Iterator[Matrix | None]:
        yield register_by_peer(read_gray(pair.left), read_gray(pair.right), name, count)

    return run


def read_gray(image: Path | Pixels) -> Pixels:
    """A pair's image, from its file or as it is."""
    if isinstance(image, np.ndarray):
        return image
    return np.asarray(cv2.imread(str(image), cv2.IMREAD_GRAYSCALE), dtype=np.uint8)
