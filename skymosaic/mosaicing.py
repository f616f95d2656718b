"""From overlapping photographs to one mosaic: the plan that the API, the command line and the panel share."""

from __future__ import annotations

import dataclasses
import re
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from golden_model.arrays import Intensities, Mask, Pixels
from skymosaic.compositing.mesh import better_mesh, fit_mesh
from skymosaic.errors import InputError, RegistrationError
from skymosaic.features.positions import match_points
from skymosaic.flight.cache import ResultCache
from skymosaic.flight.composition import Composition, compose, forget_decoded, keep_decoded
from skymosaic.flight.layout import Layout
from skymosaic.flight.mapping import place_on_map
from skymosaic.flight.output import PLAIN, PREVIEW_WIDTH_PX, Delivery, OutputForm, deliver
from skymosaic.flight.pair import flight_of_pair
from skymosaic.flight.survey import Flight, survey
from skymosaic.flight.workers import Progress, Workers, silent
from skymosaic.imagery import images as pictures
from skymosaic.imagery.key_frames import flight_sources
from skymosaic.imagery.lens import Lens
from skymosaic.imagery.own_outputs import remember
from skymosaic.imagery.photographs import Source
from skymosaic.mosaic_options import FLIGHT, PAIR, MosaicOptions
from skymosaic.mosaic_result import Mosaic
from skymosaic.pair import Pair
from skymosaic.registration import register_photographs
from skymosaic.stopwatch import Stopwatch


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

    Examples
    --------
    >>> from sim.scene import pair as rendered_pair
    >>> result = mosaic(rendered_pair(seed=5, size=(320, 240)).images)
    >>> result.placed, result.left_out
    ((0, 1), {})
    >>> result.transforms[1].shape, result.image.dtype
    ((3, 3), dtype('uint8'))
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
    with planned_sources(sources, MosaicOptions(**options)) as plan:
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
        Receives a line for each video that is cut off, or if the cache cannot be written.

    Raises
    ------
    InputError
        For a folder without pictures, an unreadable video, unusable options, or an absent scheduler.
    """
    progress("reading", 0, 0)
    with flight_sources(images, tell) as sources, planned_sources(sources, options, progress, tell) as plan:
        yield plan


@contextmanager
def planned_sources(
    sources: Sequence[Source],
    options: MosaicOptions,
    progress: Progress = silent,
    tell: Callable[[str], None] = lambda _line: None,
) -> Iterator[MosaicPlan]:
    """`planned` for photographs that are already listed."""
    options.check(len(sources))
    sources = [dataclasses.replace(source, keep_damaged=options.damaged == "keep") for source in sources]
    try:
        with Workers(options.scheduler, progress=progress) as workers:
            yield MosaicPlan(sources, options, workers, tell)
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
    tell : callable
        Receives a line if the cache cannot be written.
    """

    def __init__(
        self,
        sources: Sequence[Source],
        options: MosaicOptions,
        workers: Workers,
        tell: Callable[[str], None] = lambda _line: None,
    ) -> None:
        self._tell = tell
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
        cache = ResultCache(options.cache or options.default_cache, required=options.cache is not None, tell=self._tell)
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
        """Canvas, exposure and seams of one group.

        Raises
        ------
        InputError
            If the scale leaves less than a pixel.
        """
        options, style = self.options, self._style
        composition = compose(
            self.flight,
            layout,
            blending=options.blending or style.blending,
            scale=options.scale,
            canvas_limit_px=options.canvas_limit_px,
            equalise=style.equalise,
            seams=style.seams,
            own_frame=style.own_frame,
            place=place_on_map(self.flight, layout, options.control),
            gsd_m=options.gsd_m,
        )
        if min(composition.size) < 1:
            raise InputError("the mosaic is smaller than a pixel; raise --scale, or lower --gsd")
        return composition

    def bands(self, composition: Composition) -> Iterator[tuple[Intensities, Mask]]:
        """The blended picture in bands of whole rows from the top, and where they show a photograph."""
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
            layout=layout,
            composition=composition,
        )

    def check_outputs(self, output: Path, form: OutputForm = PLAIN, *, overwrite: bool = False) -> None:
        """Check that `write` could write there, before anything is computed.

        Raises
        ------
        InputError
            For an output that cannot be written, is one of the photographs, or exists and must not be overwritten;
            for a form that does not suit it.
        """
        form.check(output)
        if form.tiles is not None:
            pictures.check_unused(form.tiles, overwrite=overwrite)
        pictures.check_output(output, tuple(source.name for source in self.sources), overwrite=overwrite)
        if self.options.all_groups:
            numbered = re.compile(re.escape(output.stem) + r"_\d+" + re.escape(output.suffix))
            for path in sorted(output.parent.iterdir()):
                if numbered.fullmatch(path.name):
                    pictures.check_unused(path, overwrite=overwrite)

    def write(
        self,
        output: Path,
        form: OutputForm = PLAIN,
        *,
        preview_width_px: int = PREVIEW_WIDTH_PX,
        overwrite: bool = False,
    ) -> list[Delivery]:
        """Write the mosaic of the largest group; with ``all_groups`` those of the others too, numbered from 2.

        Raises
        ------
        InputError
            As `check_outputs`.
        RegistrationError
            As `layouts`.
        """
        self.check_outputs(output, form, overwrite=overwrite)
        layouts = self.layouts if self.options.all_groups else self.layouts[:1]
        compositions = [self.composition(layout) for layout in layouts]
        paths = [output, *(output.with_stem(f"{output.stem}_{number}") for number in range(2, len(layouts) + 1))]
        deliveries = [
            deliver(
                path,
                self.flight,
                layout,
                composition,
                self.bands(composition),
                form=form.numbered(number),
                preview_width_px=preview_width_px,
            )
            for number, (path, layout, composition) in enumerate(
                zip(paths, layouts, compositions, strict=True), start=1
            )
        ]
        photographs = [source.content for source in self.sources if isinstance(source.content, Path)]
        for path in paths:
            remember(path, photographs)
        return deliveries

    def _registered(self) -> Flight:
        """Two photographs, registered as a pair."""
        options, lens = self.options, self.options.lens or Lens()
        self._workers.progress("registering", 0, 0)
        clock = Stopwatch()
        left, right = (source.photograph(lens) for source in self.sources)
        clock.lap("reading")
        pair = register_photographs(
            (left, right),
            config=options.usual_config,
            detector=options.detector,
            descriptor=options.descriptor,
            estimator=options.estimator,
            effort=options.effort,
            backend=options.backend,
            seed=options.seed,
            working_width_px=options.working_width_px,
            refine=options.refine,
            lens=lens,
            seconds=clock.seconds,
            progress=lambda line: self._workers.progress(line, 0, 0),
        )
        bend = bend_of(pair, options.warp)
        if bend is not None:
            self.sources = [dataclasses.replace(self.sources[0], bend=bend), self.sources[1]]
            left = dataclasses.replace(left, pixels=np.asarray(bend(left.pixels), dtype=np.uint8))
        for source, photograph in zip(self.sources, (left, right), strict=True):
            keep_decoded(source, lens, photograph.pixels, options.memory_bytes)
        return flight_of_pair(pair, self.sources, lens)


def bend_of(pair: Pair, warp: str) -> Callable[[Intensities], Intensities] | None:
    """What bends the left photograph of a pair as ``warp`` says; None where nothing does.

    Parameters
    ----------
    pair : Pair
    warp : {"homography", "mesh", "auto"}
        auto: a grid of residuals, if held-out matches gain by it.
    """
    if warp == "homography" or pair.working_homography is None:
        return None
    left, right = match_points(pair.kept)
    size = pair.working[0].shape[1], pair.working[0].shape[0]
    given = pair.working_homography, left, right, size
    mesh = better_mesh(*given) if warp == "auto" else fit_mesh(*given)
    return None if mesh is None else mesh.bend
