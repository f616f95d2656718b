"""The project's designs, ready to be simulated."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import golden_model
import hdl
from golden_model.config import Config, EstimatorConfig, FrontEndConfig
from hdl.accelerator import Accelerator, AcceleratorTop
from hdl.axi.video_input import VIDEO_BITS
from hdl.front_end import FrontEnd
from sim.backends.interface import BUILT_LANES
from sim.simulators import front_end_top
from sim.simulators.build_cache import digest_files
from sim.simulators.design import Design, Ports
from sim.simulators.front_end_top import SETTINGS, FrontEndTop, Tap

FEATURES, MATCHES, HOMOGRAPHIES = "m_axis_features", "m_axis_matches", "m_axis_homographies"
CONTROL = "s_axi_ctrl"
BUILT_SIZES_PX = ((1920, 1080), (4096, 4096))
"""Largest width and height of the builds; a run uses the first one that its frames fit."""


def choose_build_px(frames: Sequence[NDArray[np.uint8]]) -> tuple[int, int]:
    """The largest width and height of the build that takes all ``frames``."""
    height_px, width_px = (max(sides, default=0) for sides in zip(*(image.shape[:2] for image in frames), strict=True))
    return next(size for size in BUILT_SIZES_PX if width_px <= size[0] and height_px <= size[1])


def design_accelerator(
    config: Config, max_size_px: tuple[int, int], *, lanes: int = BUILT_LANES, video_bits: int = VIDEO_BITS[0]
) -> Design:
    """The whole accelerator for frames up to a width and height."""
    config = strip_settings(config)
    build: dict[str, Any] = {"lanes": lanes, "video_bits": video_bits}
    build |= {"max_width_px": max_size_px[0], "max_height_px": max_size_px[1]}
    return Design(
        "the accelerator",
        Ports(outputs=(FEATURES, MATCHES, *((HOMOGRAPHIES,) if config.estimator else ())), control=CONTROL),
        lambda: AcceleratorTop(Accelerator(config=config, **build)),
        f"{config} {build} {digest_sources()}",
    )


def design_front_end(
    config: FrontEndConfig,
    max_size_px: tuple[int, int],
    *,
    taps: tuple[Tap, ...] = (),
    video_bits: int = VIDEO_BITS[0],
) -> Design:
    """The front end alone for frames up to a width and height, with ``taps`` that show stages."""
    config = _strip_front_end_settings(config)
    size = {"max_width_px": max_size_px[0], "max_height_px": max_size_px[1], "video_bits": video_bits}
    return Design(
        "the front end",
        Ports(outputs=(FEATURES,), settings=SETTINGS, taps=tuple(tap.port for tap in taps)),
        lambda: FrontEndTop(FrontEnd(config=config, **size), taps=taps),
        f"{config} {size} {taps} {digest_sources()}",
    )


def strip_settings(config: Config) -> Config:
    """The configuration with fixed values for what is set at run time, so that all settings share one build."""
    return dataclasses.replace(
        config,
        preset="any",
        front_end=_strip_front_end_settings(config.front_end),
        matcher=dataclasses.replace(config.matcher, keep_above=0),
        estimator=EstimatorConfig() if config.estimator else None,
    )


def _strip_front_end_settings(config: FrontEndConfig) -> FrontEndConfig:
    return dataclasses.replace(config, detector="harris", threshold=1, cell_px=None, per_cell=None)


@functools.cache
def digest_sources() -> str:
    """A hash of all sources that the designs are made from."""
    folders = [Path(package.__path__[0]) for package in (golden_model, hdl)]
    return digest_files([*(path for folder in folders for path in folder.rglob("*.py")), Path(front_end_top.__file__)])
