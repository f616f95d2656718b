"""The options of a mosaic, and which of them apply to two photographs and which to more."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from golden_model.config import Config, preset_config
from skymosaic.compositing.blend import METHODS
from skymosaic.compositing.warp import CANVAS_LIMIT_PX
from skymosaic.errors import InputError
from skymosaic.flight.linking.view import Settings
from skymosaic.flight.picture.composition import MEMORY_BYTES
from skymosaic.imagery.images import keeps_damaged
from skymosaic.imagery.lens import Lens
from skymosaic.maps.control_points import ControlPoints
from skymosaic.registration.passes import settled_effort
from skymosaic.registration.register import WORKING_WIDTH_PX, settled_method

USUAL_ESTIMATOR = "prosac"

WARPS = ("homography", "mesh", "auto")


@dataclass(frozen=True, kw_only=True)
class MosaicOptions:
    """Every choice of a mosaic. Each one applies, or `check` refuses it with the reason.

    Attributes
    ----------
    blending : {"average", "distance", "multiband"} or None
        None: distance for two photographs, multiband along seams for more.
    scale : float
        Canvas pixels a pixel of the reference, more than 0 and at most 1. The reference is the right one of two
        photographs, of more the most connected one, without its tilt.
    gsd_m : float or None
        Metres on the ground for each canvas pixel, instead of `scale`; takes GPS.
    canvas_limit_px : int
        Largest canvas area that is accepted.
    preset : str
        ``"aerial"`` or ``"thesis"``; `config` overrides it.
    config : Config or None
    detector, descriptor : str or None
        As `skymosaic.registration.register.register`; more than two photographs take Harris or FAST with ILBP.
    estimator : str
        Robust estimator, for two photographs; more take prosac.
    effort : {"fast", "normal", "thorough"} or None
        How many frames are tried, for two photographs; see `skymosaic.registration.passes`.
    warp : {"homography", "mesh", "auto"}
        mesh: bend the left one of two photographs to follow the relief; auto: only if held-out matches gain by it.
    backend : str
        What computes the features, and of two photographs the matches: ``golden``, ``rtl``, ...
    seed : int
        Of the robust estimator.
    working_width_px : int
        Wider photographs are reduced by area for features and layout.
    refine : bool
        A second, guided pass, for two photographs.
    damaged : {"refuse", "keep"}
        Refuse a damaged JPEG (a flight of more than two photographs leaves it out), or use what can be decoded of it.
    lens : Lens or None
        Distortion and mask that all photographs share, from `skymosaic.imagery.lens.load_lens`.
    band : str or None
        Of multi-band sets, the band that registers the flight; None: see `skymosaic.imagery.band_sets.group_band_sets`.
    control : ControlPoints or None
        Ground control points, from `skymosaic.maps.control_points.load_control_points`, instead of GPS.
    all_groups : bool
        Write a mosaic of each group of photographs, for more than two.
    scheduler : str or None
        Address of a Dask scheduler; None: threads. Two photographs are registered here and blended there.
    cache : Path or None
        Folder that keeps features and links for the next run, for more than two photographs.
    default_cache : Path or None
        The same where `cache` is None; ignored for two photographs.
    memory_bytes : int
        Limit of the decoded photographs that are kept at once.
    """

    blending: str | None = None
    scale: float = 1.0
    gsd_m: float | None = None
    canvas_limit_px: int = CANVAS_LIMIT_PX
    preset: str = "aerial"
    config: Config | None = None
    detector: str | None = None
    descriptor: str | None = None
    estimator: str = USUAL_ESTIMATOR
    effort: str | None = None
    warp: str = "homography"
    backend: str = "golden"
    seed: int = 0
    working_width_px: int = WORKING_WIDTH_PX
    refine: bool = False
    damaged: str = "refuse"
    lens: Lens | None = None
    band: str | None = None
    control: ControlPoints | None = None
    all_groups: bool = False
    scheduler: str | None = None
    cache: Path | None = None
    default_cache: Path | None = None
    memory_bytes: int = MEMORY_BYTES

    def check(self, photographs: int) -> None:
        """Refuse what cannot apply to so many photographs, before the long work begins.

        Raises
        ------
        InputError
            For an unknown name, an impossible value or combination, or an option that would have no effect.
        """
        if photographs < 2:
            raise InputError(f"a mosaic takes at least two photographs, not {photographs}")
        if not 0 < self.scale <= 1:
            raise InputError(f"scale is {self.scale}; it must be more than 0 and at most 1")
        if self.gsd_m is not None and not 0 < self.gsd_m < math.inf:
            raise InputError(f"gsd is {self.gsd_m}; it must be more than 0 metres a pixel")
        if self.gsd_m is not None and self.scale != 1:
            raise InputError("gsd and scale both set the size of the mosaic; leave one out")
        if self.blending is not None and self.blending not in METHODS:
            raise InputError(f"blending is {self.blending!r}; valid: {', '.join(METHODS)}")
        keeps_damaged(self.damaged)
        if self.warp not in WARPS:
            raise InputError(f"warp is {self.warp!r}; valid: {', '.join(WARPS)}")
        for given, reason in self._without_effect(photographs):
            if given:
                raise InputError(reason)

    def _without_effect(self, photographs: int) -> Iterator[tuple[object, str]]:
        """Conditions under which an option has no effect, each with the message."""
        method, _ = settled_method(self.usual_config, self.detector, self.descriptor, self.estimator, self.refine)
        if photographs == 2:
            settled_effort(self.effort, method, self.estimator, self.backend)
            masked = self.lens is not None and self.lens.mask is not None
            yield (
                masked and self.warp != "homography",
                "warp: a mask would not be bent with the photograph; leave one out",
            )
            yield self.all_groups, "all groups: two photographs make one mosaic; leave out --all-groups"
            yield self.cache, "cache: two photographs are registered anew each time; leave out --cache"
            return
        few = "or leave two photographs"
        yield (
            not method.on_accelerator,
            f"{method.detector} with {method.descriptor}: more than two photographs take Harris or FAST with ILBP, "
            f"by which overlaps are found; choose these, {few}",
        )
        yield (
            self.estimator != USUAL_ESTIMATOR,
            f"estimator {self.estimator}: more than two photographs are linked by {USUAL_ESTIMATOR}, whose result "
            f"the layout then refines; leave out --estimator, {few}",
        )
        yield (
            self.effort,
            f"effort {self.effort}: more than two photographs are linked by one pass each; leave out --effort, {few}",
        )
        yield (
            self.warp != "homography",
            f"warp {self.warp}: more than two photographs are laid out by homographies; leave out --warp, {few}",
        )
        yield (
            self.refine,
            f"refine: the layout of more than two photographs is refined by all links; leave out --refine, {few}",
        )

    @property
    def usual_config(self) -> Config:
        """The configuration, or that of the preset."""
        return self.config or preset_config(self.preset)

    def settings(self) -> Settings:
        """Of a flight's features."""
        _, config = settled_method(self.usual_config, self.detector, self.descriptor, self.estimator, refine=False)
        return Settings(config, self.backend, self.working_width_px, self.lens or Lens())
