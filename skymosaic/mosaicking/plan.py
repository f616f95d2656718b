"""The stages of a mosaic: the plan that the API, the command line and the panel share."""

import contextlib
import dataclasses
import os
import re
import time
from collections.abc import Callable, Iterator, Sequence
from functools import cached_property
from pathlib import Path

import numpy as np

from golden_model.arrays import Intensities, Mask
from golden_model.config import MIN_FRAME_PX
from golden_model.user_cache import cache_folder
from skymosaic.common.errors import InputError, RegistrationError
from skymosaic.common.memory import release_free_memory
from skymosaic.common.stopwatch import Stopwatch
from skymosaic.compositing.mesh import Mesh, fit_mesh, fit_useful_mesh
from skymosaic.features.positions import match_points
from skymosaic.flight.bands.spectrum import in_all_bands
from skymosaic.flight.layout.layout import Layout
from skymosaic.flight.mapping.place import MapPlace, explain_absence, fit_layout, place_on_map
from skymosaic.flight.picture.composition import Composition, Room
from skymosaic.flight.picture.output import (
    PLAIN,
    PREVIEW_WIDTH_PX,
    Delivery,
    OutputForm,
    deliver,
    room_for,
    too_deep_for_jpeg,
)
from skymosaic.flight.picture.preparation import check_scale, compose
from skymosaic.flight.repetition import repeat_flight
from skymosaic.flight.survey import Flight, survey
from skymosaic.flight.two_photographs import flight_of_pair
from skymosaic.imagery import images as pictures
from skymosaic.imagery.decoding import read_header
from skymosaic.imagery.exif import read_metadata
from skymosaic.imagery.lens import Lens
from skymosaic.imagery.photographs import Source, decoded_photographs
from skymosaic.maps.tiles import OWN_NAMES
from skymosaic.mosaicking.options import MEGAPIXEL, MosaicOptions
from skymosaic.mosaicking.result import Mosaic
from skymosaic.registration.pair import Pair
from skymosaic.registration.register import register_photographs
from skymosaic.running.cache import ResultCache
from skymosaic.running.workers import Workers

MIN_ROOM_PX = 1_000_000
"""A disk with less room is refused before the first feature; one with more gets a reduced mosaic."""
DEFAULT_CACHE_BYTES = 2 << 30
"""About 5,000 photographs of 1280 working px; a folder that the user named has no limit."""


class MosaicPlan:
    """The stages from photographs to mosaics: features, links, layout, exposure, seams, blending, output.

    Parameters
    ----------
    sources : sequence of Source
        The photographs.
    options : MosaicOptions
        Checked for this number of photographs.
    workers : Workers
    tell : callable
        Receives a line if the cache cannot be written, or if control points name other photographs.
    """

    def __init__(
        self, sources: Sequence[Source], options: MosaicOptions, workers: Workers, tell: Callable[[str], None]
    ) -> None:
        self.sources = sources
        self.options = options
        self._workers = workers
        self._tell = tell
        control = options.control
        # Unlike a position, a sighting is one of several, and surveys share a file; but it may be misspelt.
        if control is not None and (unknown := control.unmatched_names([source.name for source in sources])):
            tell(f"note: {control.name}: no photograph is named {', '.join(unknown)}; these sightings are left out")

    @cached_property
    def flight(self) -> Flight:
        """Features, links and layouts; computed when they are first needed."""
        if self.options.layout is not None:
            known, cache = self.options.layout.flight, open_cache(self.options, self._tell)
            return repeat_flight(known, self.sources, self.options.seed, self._workers, cache)
        if len(self.sources) == 2:
            return self._register()
        return survey_sources(self.sources, self.options, self._workers, self._tell)

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

    def room(self, path: Path | None) -> Room:
        """How large a mosaic in this file may become; None: in memory."""
        if self.options.canvas_limit_px is not None:
            limit_px = self.options.canvas_limit_px
            return Room(limit_px, reason=f"--canvas-limit is {limit_px / MEGAPIXEL:g} megapixels")
        if path is None or len(self.sources) == 2:
            return Room()
        return room_for(path, 1 + max(3, len(self.sources[0].bands)))

    def composition(self, layout: Layout, path: Path | None = None) -> Composition:
        """Canvas, exposure and seams of one group, for a file or for the memory.

        Raises
        ------
        InputError
            As in `skymosaic.flight.picture.preparation.compose`.
        """
        options = self.options
        if self.flight.pair is None:
            self._workers.progress("exposure and seams", 0, 0)
        place = self._place(layout)
        release_free_memory()
        composition = compose(
            self.flight,
            layout,
            blending=options.blending,
            scale=options.scale,
            room=self.room(path),
            place=place,
            # A group without a place has the resolution of its photographs.
            gsd_m=options.gsd_m if place.georeference is not None or layout is self.layouts[0] else None,
        )
        if not self.sources[0].bands:
            return composition
        return in_all_bands(composition, self.flight, layout, self._workers)

    def _place(self, layout: Layout) -> MapPlace:
        """The place of a layout on the map; none for a further group that the control points do not reach."""
        try:
            return place_on_map(self.flight, layout, self.options.control)
        except InputError as error:
            if layout is self.layouts[0]:
                raise
            return MapPlace(note=str(error))

    def bands(self, composition: Composition) -> Iterator[tuple[Intensities, Mask]]:
        """Render the picture in bands of whole rows from the top, each with a mask of what shows a photograph."""
        start = time.perf_counter()
        release_free_memory()
        yield from composition.bands(self._workers, self.options.memory_bytes)
        # A pair counts its blending among its own stages; the time of a flight's is in its delivery.
        if self.flight.pair is not None:
            self.flight.pair.seconds["warping and blending"] = time.perf_counter() - start

    def mosaic(self, layout: Layout) -> Mosaic:
        """The mosaic of one group in memory."""
        composition = self.composition(layout)
        return Mosaic(composition.joined(self.bands(composition)), self.flight, layout, composition)

    def check_outputs(self, output: Path, form: OutputForm = PLAIN, *, overwrite: bool = False) -> None:
        """Check that `write` can write there, before anything is computed.

        Raises
        ------
        InputError
            For an output that cannot be written, would replace a photograph, or exists and must not be overwritten;
            for a form that does not suit it.
        RegistrationError
            For a map that is required where nothing can give the mosaic a place.
        """
        form.check(output, len(self.sources[0].bands))
        self._check_headers(output, form)
        inputs = tuple(name for source in self.sources for name in source.files)
        if form.tiles is not None:
            pictures.check_output_folder(form.tiles, inputs, OWN_NAMES, overwrite=overwrite)
        pictures.check_output(output, inputs, overwrite=overwrite)
        room = self.room(output)
        if self.options.canvas_limit_px is None and room.area_px < MIN_ROOM_PX:
            raise InputError(f"{output}: {room.reason}, too little for a mosaic; free some, or choose another folder")
        if form.require_map and not self._may_have_place():
            place = MapPlace(note=f"0 of {len(self.sources)} photographs have GPS")
            raise RegistrationError(f"{explain_absence(output, place)}; nothing was written")
        if self.options.all_groups:
            # How many groups there are is not known yet.
            for path in _numbered_beside(output):
                pictures.check_output(path, inputs, overwrite=overwrite)
            if form.tiles is not None:
                for path in _numbered_beside(form.tiles):
                    pictures.check_output_folder(path, inputs, OWN_NAMES, overwrite=overwrite)

    def _check_headers(self, output: Path, form: OutputForm) -> None:
        """Refuse what the sizes and depths that the photographs declare already forbid."""
        if form.compress != "jpeg" and self.options.scale * MIN_FRAME_PX >= 1:
            return
        headers = []
        for source in self.sources:
            # What cannot be read is said when it is read.
            with contextlib.suppress(InputError):
                headers += [read_header(source.content)] if isinstance(source.content, Path) else []
        if len(headers) < len(self.sources):
            return
        check_scale(self.options.scale, [header.size for header in headers])
        if form.compress == "jpeg" and all(header.sample_bytes == 2 for header in headers):
            raise too_deep_for_jpeg(output)

    def _may_have_place(self) -> bool:
        """Whether there is anything by which the mosaic could be placed on the map."""
        if self.options.control is not None or self.options.positions is not None or self.options.layout is not None:
            return True
        files = [source.content for source in self.sources if isinstance(source.content, Path)]
        # What cannot be read is said when it is read.
        return any(not os.access(file, os.R_OK) or read_metadata(file).position for file in files)

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
            As in `check_outputs`.
        RegistrationError
            As in `layouts`; for a mosaic without a place on the map where ``form`` requires one.
        """
        self.check_outputs(output, form, overwrite=overwrite)
        layouts = self.layouts if self.options.all_groups else self.layouts[:1]
        # All of them before the first is written: one that cannot be made leaves no half of the mosaics behind.
        compositions = [self.composition(layout, output) for layout in layouts]
        if form.require_map:
            for composition in compositions:
                if composition.place.georeference is None:
                    raise RegistrationError(f"{explain_absence(output, composition.place)}; nothing was written")
        deliveries = []
        for number, (layout, composition) in enumerate(zip(layouts, compositions, strict=True), start=1):
            path = output if number == 1 else output.with_stem(f"{output.stem}_{number}")
            bands, numbered = self.bands(composition), form.numbered(number)
            deliveries.append(
                deliver(path, self.flight, layout, composition, bands, form=numbered, preview_width_px=preview_width_px)
            )
        return deliveries

    def _register(self) -> Flight:
        """Register two photographs, and keep them decoded for the picture."""
        options, lens = self.options, self.options.lens or Lens()
        self._workers.progress("registering", 0, 0)
        clock = Stopwatch()
        left, right = (source.read_photograph(lens) for source in self.sources)
        for photograph in (left, right):
            lens.check((photograph.pixels.shape[1], photograph.pixels.shape[0]), photograph.name)
        clock.lap("reading")
        pair = register_photographs(
            (left, right),
            options,
            lens=lens,
            seconds=clock.seconds,
            progress=lambda line: self._workers.progress(line, 0, 0),
        )
        mesh = choose_mesh(pair, options.warp)
        if mesh is not None:
            # Blending decodes the left photograph again where memory is short, and warps it again.
            self.sources = [dataclasses.replace(self.sources[0], warp=mesh), self.sources[1]]
            left = dataclasses.replace(left, pixels=np.asarray(mesh.apply(left.pixels), dtype=np.uint8))
        for source, photograph in zip(self.sources, (left, right), strict=True):
            decoded_photographs(options.memory_bytes).keep(source, lens, photograph.pixels)
        return flight_of_pair(pair, self.sources, lens)


def _numbered_beside(base: Path) -> list[Path]:
    """What exists under the names that the outputs of further groups get.

    Raises
    ------
    InputError
        For a folder such as ".", to whose name no number can be added.
    """
    if base.name in ("", ".."):
        raise InputError(f"{base}: has no name that could be numbered for several groups; name another folder")
    numbered = re.compile(re.escape(base.stem) + r"_\d+" + re.escape(base.suffix))
    return [path for path in sorted(base.parent.glob("*")) if numbered.fullmatch(path.name)]


def survey_sources(
    sources: Sequence[Source], options: MosaicOptions, workers: Workers, tell: Callable[[str], None]
) -> Flight:
    """Link and lay out a flight's photographs; features and links come from the cache where it has them."""
    flight = survey(
        sources,
        options.flight_settings(),
        options.seed,
        workers,
        open_cache(options, tell),
        positions=options.positions,
    )
    layouts = tuple(fit_layout(flight, layout, options.control) for layout in flight.layouts)
    return dataclasses.replace(flight, layouts=layouts)


def open_cache(options: MosaicOptions, tell: Callable[[str], None]) -> ResultCache:
    """The cache that the options name, or the user's own."""
    if options.cache is not None:
        return ResultCache(options.cache, required=True, tell=tell)
    return ResultCache(cache_folder() / "flights", tell=tell, limit_bytes=DEFAULT_CACHE_BYTES)


def choose_mesh(pair: Pair, warp: str) -> Mesh | None:
    """Fit the mesh that warps the left photograph of a pair to follow the relief; None where it keeps its shape.

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
    fit = fit_useful_mesh if warp == "auto" else fit_mesh
    return fit(pair.working_homography, left, right, size)
