"""The road of a mosaic, stage by stage, which the API, the command line and the panel share."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path

from golden_model.arrays import Intensities
from skymosaic.common.errors import InputError, RegistrationError, noting
from skymosaic.common.memory import release_free_memory
from skymosaic.common.stopwatch import Stopwatch
from skymosaic.flight.flight import Flight
from skymosaic.flight.layout.layout import Layout
from skymosaic.flight.mapping.place import MapPlace, place_on_map, require_place
from skymosaic.flight.picture.composition import Composition
from skymosaic.flight.picture.formats import PLAIN, OutputForm, check_size, numbered
from skymosaic.flight.picture.output import PREVIEW_WIDTH_PX, Delivery, deliver
from skymosaic.flight.picture.preparation import compose
from skymosaic.flight.picture.relief import follow_relief
from skymosaic.flight.picture.spectrum import in_all_bands
from skymosaic.flight.repetition import repeat_flight
from skymosaic.flight.survey import survey
from skymosaic.flight.two_photographs import register_two
from skymosaic.imagery.colour import PROFILE
from skymosaic.imagery.exif import describe_days
from skymosaic.imagery.images import FIRST_PAGE
from skymosaic.imagery.lens import Lens
from skymosaic.imagery.photographs import Source
from skymosaic.maps.boundary import OutsideError
from skymosaic.maps.geotiff import Shown
from skymosaic.mosaicking.options import MosaicOptions, SurveyOptions
from skymosaic.mosaicking.outputs import check_outputs, room_of
from skymosaic.mosaicking.result import Mosaic
from skymosaic.running.cache import open_cache
from skymosaic.running.workers import Workers

MAX_REASONS = 3
"""Photographs of a refused flight that are named with their reasons; most have the same."""


class MosaicRun:
    """From photographs to mosaics; `write` is the whole road, `mosaic` the same into memory.

    The options are checked for this number of photographs. ``tell`` receives a line if the cache cannot be written, or
    if control points name other photographs. A ``flight`` that is given is not computed.
    """

    def __init__(
        self,
        sources: Sequence[Source],
        options: MosaicOptions,
        workers: Workers,
        tell: Callable[[str], None],
        flight: Flight | None = None,
    ) -> None:
        self.sources = sources
        self.options = options
        self._workers = workers
        self._tell = tell
        self._flight = flight
        control = options.control_points
        # Unlike a position, a sighting is one of several, and surveys share a file; but it may be misspelt.
        if control is not None and (unknown := control.unmatched_names([source.name for source in sources])):
            tell(f"note: {control.name}: no photograph is named {', '.join(unknown)}; these sightings are left out")

    def write(
        self,
        output: Path,
        form: OutputForm = PLAIN,
        *,
        preview_width_px: int = PREVIEW_WIDTH_PX,
        overwrite: bool = False,
        on_absent: Callable[[Mapping[int, str]], None] = lambda _reasons: None,
    ) -> list[Delivery]:
        """Write the mosaic of the largest group; with ``all_groups`` those of the others too, numbered from 2.

        Parameters
        ----------
        output, form, preview_width_px, overwrite
            As in `check_outputs` and `deliver`.
        on_absent : callable
            Receives which photographs will be missing, by their index, with the reason; then also those that change
            while the picture is made, which begins anew without them.

        Raises
        ------
        InputError
            As in `skymosaic.mosaicking.outputs.check_outputs`.
        RegistrationError
            As in `layouts`; for a mosaic without a place on the map where ``form`` requires one.
        """
        # What can be refused is refused before the work begins.
        computed = self._flight is not None
        check_outputs(output, form, self.sources, self.options, overwrite=overwrite, computed=computed)
        absent: dict[int, str] = {}
        while True:
            # Features, links, lens, layouts and their places on the map.
            layouts = self.layouts if self.options.all_groups else self.layouts[:1]
            known = absent
            absent = self.flight.left_out if self.options.all_groups else self.flight.absent_from(layouts[0])
            on_absent({index: reason for index, reason in absent.items() if index not in known})
            try:
                return self._write(layouts, output, form, preview_width_px)
            except InputError:
                if not self._leave_out_changed():
                    raise

    def _write(
        self, layouts: Sequence[Layout], output: Path, form: OutputForm, preview_width_px: int
    ) -> list[Delivery]:
        # Canvas, exposure and seams; of all groups, since one that cannot be made leaves no half of the mosaics behind.
        composed, outside = list[tuple[Layout, Composition]](), list[OutsideError]()
        for layout in layouts:
            try:
                composed.append((layout, self.composition(layout, output)))
            except OutsideError as error:
                outside.append(error)
        if not composed:
            raise outside[0]
        for reason in outside:
            self._tell(f"note: a group is left out: {reason}")
        for _, composition in composed if form.needs_place(output) else ():
            require_place(output, composition.place)
        deliveries, failures = list[Delivery](), list[str]()
        for number, (layout, composition) in enumerate(composed, start=1):
            # Warped and blended band by band, while the file is written.
            bands, path = self.bands(composition), numbered(output, number)
            own_form = form.numbered(number)
            # Of several, those that are written stay, and have their report.
            with noting(failures) if deliveries else nullcontext():
                deliveries.append(
                    deliver(
                        path, self.flight, layout, composition, bands, form=own_form, preview_width_px=preview_width_px
                    )
                )
        deliveries[-1] = replace(deliveries[-1], failures=(*deliveries[-1].failures, *failures))
        return deliveries

    def mosaics(self) -> Iterator[Mosaic]:
        """The mosaic of each group in memory, the largest first; raises as `write`."""
        number = yielded = 0
        while number < len(self.layouts):
            layout = self.layouts[number]
            try:
                composition = self.composition(layout)
                image = composition.joined(self.bands(composition))
            except OutsideError as error:
                number += 1
                if not yielded and number == len(self.layouts):
                    raise
                self._tell(f"note: a group is left out: {error}")
            except InputError:
                if not self._leave_out_changed():
                    raise
            else:
                yield Mosaic(image, self.flight, layout, composition)
                number, yielded = number + 1, yielded + 1

    def _leave_out_changed(self) -> bool:
        """Leave out placed photographs that are no longer what they were when they were laid out; whether any were."""
        placed = [member for layout in self.flight.layouts for member in layout.members]
        changes = {member: change for member in placed if (change := self.flight.sources[member].change)}
        self._flight = self.flight.without(changes)
        return bool(changes)

    @property
    def flight(self) -> Flight:
        """Features, links, lens and layouts; computed when they are first needed."""
        if self._flight is None:
            self._flight = self._compute_flight()
        return self._flight

    def _compute_flight(self) -> Flight:
        options, progress = self.options, self._workers.progress
        if options.repeat is not None:
            cache = open_cache(options.cache, self._tell)
            return repeat_flight(options.repeat.flight, self.sources, options.seed, self._workers, cache)
        if len(self.sources) == 2:
            return register_two(
                self.sources,
                options,
                options.lens or Lens(),
                given=options.read_matches(2).get((0, 1)),
                bend=options.warp == "auto",
                memory_bytes=options.memory_bytes,
                progress=progress,
            )
        flight = lay_out(self.sources, options, self._workers, self._tell)
        return follow_relief(flight) if options.warp == "auto" else flight

    @property
    def layouts(self) -> tuple[Layout, ...]:
        """The groups of linked photographs, the largest first.

        Raises
        ------
        RegistrationError
            If there is none.
        """
        flight, pair = self.flight, self.flight.pair
        if pair is not None and not pair.accepted:
            raise RegistrationError(f"{pair.left.name} and {pair.right.name} cannot be registered: {pair.reason}")
        if not flight.layouts:
            linked, (*reasons,) = sum(link.holds for link in flight.links), flight.left_out.values()
            more = f"; and {len(reasons) - MAX_REASONS} more photographs" if len(reasons) > MAX_REASONS else ""
            raise RegistrationError(
                f"no two photographs make a mosaic; {linked} of {len(flight.links)} pairs show common ground: "
                f"{'; '.join(reasons[:MAX_REASONS])}{more}"
            )
        return flight.layouts

    def composition(self, layout: Layout, path: Path | None = None) -> Composition:
        """Place on the map, canvas, exposure and seams of one group, for a file or for the memory.

        Raises
        ------
        InputError
            As in `skymosaic.flight.picture.preparation.compose`, and for two photographs whose mosaic is larger than
            the file can hold.
        """
        options, flight = self.options, self.flight
        if flight.pair is None:
            self._workers.progress("exposure and seams", 0, 0)
        place = self._place(layout)
        release_free_memory()
        composition = compose(
            flight,
            layout,
            blending=options.blending,
            scale=options.scale,
            room=room_of(path, self.sources, options),
            place=place,
            # A group without a place has the resolution of its photographs.
            gsd_m=options.gsd_m if place.georeference is not None or layout is self.layouts[0] else None,
            boundary=options.boundary,
        )
        if path is not None:
            check_size(path, composition.size)
        return in_all_bands(composition, flight, layout, self._workers) if self.sources[0].bands else composition

    def _place(self, layout: Layout) -> MapPlace:
        """The place of a layout on the map; none for a further group that the control points do not reach."""
        try:
            return place_on_map(self.flight, layout, self.options.control_points)
        except InputError as error:
            if layout is self.layouts[0]:
                raise
            return MapPlace(note=str(error))

    def bands(self, composition: Composition) -> Iterator[tuple[Intensities, Shown]]:
        """Render the picture in bands of whole rows from the top, each with a mask of what shows a photograph."""
        clock = Stopwatch()
        release_free_memory()
        yield from composition.bands(self._workers, self.options.memory_bytes)
        # A pair counts its blending among its own stages; the time of a flight's is in its delivery.
        if self.flight.pair is not None:
            self.flight.pair.seconds["warping and blending"] = clock.lap("blending")


def lay_out(sources: Sequence[Source], options: SurveyOptions, workers: Workers, tell: Callable[[str], None]) -> Flight:
    """The photographs linked and laid out; ``tell`` receives lines about the cache and of `tell_notes`."""
    flight = survey(
        sources,
        options.flight_settings(),
        options.seed,
        workers,
        open_cache(options.cache, tell),
        positions=options.positions,
        control=options.control_points,
        onto=options.onto,
        keep_all=options.keep_all,
        given=options.read_matches(len(sources)),
    )
    tell_notes(flight, tell)
    return flight


def tell_notes(flight: Flight, tell: Callable[[str], None]) -> None:
    """Say once that files have pages which are not read, or profiles, and that photographs are of several days."""
    for kind in (FIRST_PAGE, PROFILE):
        if such := [f"{view.name}: {note}" for view in flight.views for note in view.notes if note.startswith(kind)]:
            tell(f"note {such[0]} ({len(such)} such files)")
    if days := describe_days([view.taken for view in flight.views]):
        tell(f"note {days}")
