"""From overlapping photographs to one mosaic: the plan that the API, the command line and the panel share."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from golden_model.arrays import Matrix, Pixels
from golden_model.config import Config, preset_config
from skymosaic.compositing.blend import METHODS
from skymosaic.compositing.warp import CANVAS_LIMIT_PX
from skymosaic.errors import InputError, RegistrationError
from skymosaic.flight.cache import ResultCache
from skymosaic.flight.composition import MEMORY_BYTES, Composition, compose, forget_decoded, keep_decoded
from skymosaic.flight.layout import Layout
from skymosaic.flight.output import PREVIEW_WIDTH_PX, Delivery, deliver
from skymosaic.flight.pair import flight_of_pair
from skymosaic.flight.survey import Flight, survey
from skymosaic.flight.view import Settings
from skymosaic.flight.workers import Progress, Workers, silent
from skymosaic.imagery import images as pictures
from skymosaic.imagery.key_frames import flight_sources
from skymosaic.imagery.lens import Lens
from skymosaic.imagery.photographs import Source
from skymosaic.registration import WORKING_WIDTH_PX, Pair, register_photographs, settled_method
from skymosaic.stopwatch import Stopwatch

USUAL_ESTIMATOR = "prosac"


@dataclass(frozen=True)
class Style:
    """How photographs become one picture; see `skymosaic.flight.composition.compose` for the last three.

    Attributes
    ----------
    blending : str
        Default method.
    equalise, seams, own_frame : bool
    """

    blending: str
    equalise: bool
    seams: bool
    own_frame: bool


PAIR = Style("distance", equalise=False, seams=False, own_frame=False)
FLIGHT = Style("multiband", equalise=True, seams=True, own_frame=True)
"""Averaging would blur many photographs, of which ten may show the same ground: flights are cut along seams."""


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
    canvas_limit_px : int
        Largest canvas area that is accepted.
    preset : str
        ``"aerial"`` or ``"thesis"``; `config` overrides it.
    config : Config or None
    detector, descriptor : str or None
        As `skymosaic.registration.register`; more than two photographs take Harris or FAST with ILBP.
    estimator : str
        Robust estimator, for two photographs; more take prosac.
    backend : str
        What computes the features, and of two photographs the matches: ``golden``, ``rtl``, ...
    seed : int
        Of the robust estimator.
    working_width_px : int
        Wider photographs are reduced by area for features and layout.
    refine : bool
        A second, guided pass, for two photographs.
    lens : Lens or None
        Distortion and mask that all photographs share, from `skymosaic.imagery.lens.load_lens`.
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
    canvas_limit_px: int = CANVAS_LIMIT_PX
    preset: str = "aerial"
    config: Config | None = None
    detector: str | None = None
    descriptor: str | None = None
    estimator: str = USUAL_ESTIMATOR
    backend: str = "golden"
    seed: int = 0
    working_width_px: int = WORKING_WIDTH_PX
    refine: bool = False
    lens: Lens | None = None
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
        if self.blending is not None and self.blending not in METHODS:
            raise InputError(f"blending is {self.blending!r}; valid: {', '.join(METHODS)}")
        for given, reason in self._without_effect(photographs):
            if given:
                raise InputError(reason)

    def _without_effect(self, photographs: int) -> Iterator[tuple[object, str]]:
        """Conditions under which an option has no effect, each with the message."""
        method, _ = settled_method(self.usual_config, self.detector, self.descriptor, self.estimator, self.refine)
        if photographs == 2:
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


@dataclass(frozen=True)
class Mosaic:
    """A mosaic and how it was made.

    Attributes
    ----------
    image : ndarray of uint8, shape (H, W, 3), or (H, W) where every photograph is gray
    transforms : dict of int to ndarray, shape (3, 3)
        For each photograph in the mosaic, its original pixels to canvas pixels. Of a photograph taken with a known
        camera, its pixels once the distortion is taken out.
    placed : tuple of int
        Indices of the photographs in the mosaic.
    left_out : dict of int to str
        Indices of the others, with the reason.
    pairs : tuple of Pair
        The registration of two photographs; empty for more.
    flight : Flight or None
        Features, links and layouts.
    """

    image: Pixels
    transforms: dict[int, Matrix]
    placed: tuple[int, ...]
    left_out: dict[int, str]
    pairs: tuple[Pair, ...] = ()
    flight: Flight | None = None


def mosaic(images: Sequence[str | Path | Pixels], *, progress: Progress = silent, **options: Any) -> Mosaic:
    """Make a mosaic of overlapping photographs; of several groups, the largest.

    Parameters
    ----------
    images : sequence of paths or arrays
        At least two photographs; a folder stands for its pictures, a video for its key frames.
    progress : callable
        Receives a stage, how many of its steps are done, and how many there are (0: unknown).
    **options
        The attributes of `MosaicOptions`.

    Raises
    ------
    InputError
        For an unusable photograph, or an option that is unusable or has no effect.
    RegistrationError
        If no mosaic can be made, with the reason and the counts.
    """
    if options.get("all_groups"):
        raise InputError("all groups: mosaic() makes one mosaic; call mosaics() for one of each group")
    return next(mosaics(images, progress=progress, **options))


def mosaics(images: Sequence[str | Path | Pixels], *, progress: Progress = silent, **options: Any) -> Iterator[Mosaic]:
    """Make a mosaic of each group of photographs that overlap, the largest first; arguments as `mosaic`."""
    with planned(images, MosaicOptions(**options), progress) as plan:
        for layout in plan.layouts:
            yield plan.mosaic(layout)


def mosaic_of_pair(pair: Pair, **options: Any) -> Mosaic:
    """Blend a registered pair; the time it takes is added to ``pair.seconds``.

    Parameters
    ----------
    pair : Pair
    **options
        Those of `MosaicOptions` that come after the registration: blending, scale, canvas_limit_px, memory_bytes.

    Raises
    ------
    InputError, RegistrationError
        As `mosaic`.
    """
    sources = [Source(side, photo.name, photo.pixels) for side, photo in enumerate((pair.left, pair.right))]
    given = MosaicOptions(**options)
    given.check(len(sources))
    with Workers() as workers, _decoding():
        plan = MosaicPlan(sources, given, workers)
        plan.flight = flight_of_pair(pair, sources, Lens())
        return plan.mosaic(plan.layouts[0])


@contextmanager
def planned(
    images: Sequence[str | Path | Pixels],
    options: MosaicOptions,
    progress: Progress = silent,
    tell: Callable[[str], None] = lambda _line: None,
) -> Iterator[MosaicPlan]:
    """A plan for ``images``, with its workers and the key frames of videos for as long as the context lasts.

    Parameters
    ----------
    images, options, progress
        As `mosaic`.
    tell : callable
        Receives a line for each video that is cut off, for instance.

    Raises
    ------
    InputError
        For a folder without pictures, an unreadable video, unusable options, or an absent scheduler.
    """
    with flight_sources(images, tell) as sources:
        options.check(len(sources))
        with Workers(options.scheduler, progress=progress) as workers, _decoding():
            yield MosaicPlan(sources, options, workers)


@contextmanager
def _decoding() -> Iterator[None]:
    try:
        yield
    finally:
        forget_decoded()


class MosaicPlan:
    """The stages from photographs to mosaics: features, links, layout; exposure, seams, blend; output.

    Parameters
    ----------
    sources : sequence of Source
        The photographs.
    options : MosaicOptions
        Checked for so many.
    workers : Workers
    """

    def __init__(self, sources: Sequence[Source], options: MosaicOptions, workers: Workers) -> None:
        self.sources = sources
        self.options = options
        self._workers = workers
        self._style = PAIR if len(sources) == 2 else FLIGHT

    @cached_property
    def flight(self) -> Flight:
        """Features, links and layouts; computed when they are first needed."""
        if len(self.sources) == 2:
            return self._registered()
        options = self.options
        cache = ResultCache(options.cache or options.default_cache)
        return survey(self.sources, options.settings(), options.seed, self._workers, cache)

    @property
    def layouts(self) -> tuple[Layout, ...]:
        """The groups of linked photographs, the largest first.

        Raises
        ------
        RegistrationError
            If there is none.
        """
        pair = self.flight.pair
        if pair is not None and not pair.accepted:
            raise RegistrationError(f"{pair.left.name} and {pair.right.name} cannot be registered: {pair.reason}")
        if not self.flight.layouts:
            reasons = "; ".join(self.flight.left_out.values())
            raise RegistrationError(f"none of the photographs could be linked with another: {reasons}")
        return self.flight.layouts

    def composition(self, layout: Layout) -> Composition:
        """Canvas, exposure and seams of one group."""
        options, style = self.options, self._style
        return compose(
            self.flight,
            layout,
            blending=options.blending or style.blending,
            scale=options.scale,
            canvas_limit_px=options.canvas_limit_px,
            equalise=style.equalise,
            seams=style.seams,
            own_frame=style.own_frame,
        )

    def bands(self, composition: Composition) -> Iterator[Pixels]:
        """The blended picture in bands of whole rows from the top."""
        start = time.perf_counter()
        yield from composition.bands(self._workers, self.options.memory_bytes)
        if self.flight.pair is not None:
            self.flight.pair.seconds["warping and blending"] = time.perf_counter() - start

    def mosaic(self, layout: Layout) -> Mosaic:
        """The mosaic of one group in memory."""
        composition = self.composition(layout)
        image = composition.joined(self.bands(composition))
        indices = [placement.source.index for placement in composition.placements]
        transforms = dict(zip(indices, composition.transforms, strict=True))
        return Mosaic(
            image=image,
            transforms=transforms,
            placed=tuple(sorted(transforms)),
            left_out=self.flight.absent_from(layout),
            pairs=() if self.flight.pair is None else (self.flight.pair,),
            flight=self.flight,
        )

    def write(self, output: Path, *, preview_width_px: int = PREVIEW_WIDTH_PX) -> list[Delivery]:
        """Write the mosaic of the largest group; with ``all_groups`` those of the others too, numbered from 2.

        Raises
        ------
        InputError
            For an output that cannot be written, before anything is computed.
        RegistrationError
            As `layouts`.
        """
        pictures.check_output(output, tuple(source.name for source in self.sources))
        layouts = self.layouts if self.options.all_groups else self.layouts[:1]
        compositions = [self.composition(layout) for layout in layouts]
        paths = [output, *(output.with_stem(f"{output.stem}_{number}") for number in range(2, len(layouts) + 1))]
        return [
            deliver(path, self.flight, layout, composition, self.bands(composition), preview_width_px=preview_width_px)
            for path, layout, composition in zip(paths, layouts, compositions, strict=True)
        ]

    def _registered(self) -> Flight:
        """Two photographs, registered as a pair."""
        options, lens = self.options, self.options.lens or Lens()
        self._workers.progress("registering", 0, 0)
        clock = Stopwatch()
        left, right = (source.photograph(lens) for source in self.sources)
        for source, photograph in zip(self.sources, (left, right), strict=True):
            keep_decoded(source, lens, photograph.pixels, options.memory_bytes)
        clock.lap("reading")
        pair = register_photographs(
            (left, right),
            config=options.usual_config,
            detector=options.detector,
            descriptor=options.descriptor,
            estimator=options.estimator,
            backend=options.backend,
            seed=options.seed,
            working_width_px=options.working_width_px,
            refine=options.refine,
            lens=lens,
            seconds=clock.seconds,
            progress=lambda line: self._workers.progress(line, 0, 0),
        )
        return flight_of_pair(pair, self.sources, lens)
