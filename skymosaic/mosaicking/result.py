"""A mosaic in memory, with its provenance and its place on the map."""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from golden_model.arrays import Intensities, Matrix, Points
from skymosaic.common.errors import InputError
from skymosaic.common.tables import Table, tabulate
from skymosaic.flight.checking.check import PhotographCheck, check_flight
from skymosaic.flight.flight import Flight
from skymosaic.flight.layout.layout import Layout
from skymosaic.flight.mapping.place import require_place
from skymosaic.flight.picture.composition import Composition
from skymosaic.flight.picture.formats import OutputForm, check_size, format_of, sources_of
from skymosaic.flight.picture.output import deliver
from skymosaic.geometry.homography import apply
from skymosaic.imagery.images import check_output, save
from skymosaic.imagery.notebook import describe_in_html
from skymosaic.imagery.own_outputs import record_output
from skymosaic.imagery.photographs import forget_decoded
from skymosaic.registration.pair import Pair
from skymosaic.running.workers import Workers


@dataclass(frozen=True, repr=False, eq=False)
class Mosaic:
    """A mosaic, and the flight, layout and composition that it was made from.

    Attributes
    ----------
    image : ndarray of uint8, shape (H, W, 3), or (H, W) where every photograph is gray
        uint16 where every photograph has 16 bits; (H, W, bands) of multi-band sets.
    flight : Flight
        Features, links and layouts.
    layout : Layout
        The group of the flight that this mosaic shows.
    composition : Composition
        Canvas, exposure and seams.
    """

    image: Intensities
    flight: Flight
    layout: Layout
    composition: Composition

    @cached_property
    def transforms(self) -> dict[int, Matrix]:
        """For each photograph in the mosaic, (3, 3), its original pixels to canvas pixels.

        For a photograph taken with a known camera, its pixels without the lens's distortion; for one that a mesh warps
        over relief (``layout.meshes``), its pixels after that. `locate` takes all three steps.
        """
        indices = [placement.source.index for placement in self.composition.placements]
        return dict(zip(indices, self.composition.transforms, strict=True))

    def locate(self, photograph: int, points: Points) -> Points:
        """Find where the mosaic shows points (N, 2) of a placed photograph, by its index; px of either picture.

        The points are pixels of the photograph as it is given, turned upright.

        Raises
        ------
        InputError
            For a photograph that the mosaic does not show.
        """
        flight = self.flight
        if photograph not in self.transforms:
            raise InputError(f"photograph {photograph} is not in the mosaic; give one of `placed`")
        member = next(m for m in self.layout.members if flight.sources[m].index == photograph)
        view = flight.views[member]
        straight = flight.lens.turned(view.orientation).straighten_points(np.asarray(points, np.float64), view.size)
        return apply(self.transforms[photograph], self.layout.bend(member, view, straight))

    @property
    def placed(self) -> tuple[int, ...]:
        """Indices of the photographs in the mosaic."""
        return tuple(sorted(self.transforms))

    @property
    def left_out(self) -> dict[int, str]:
        """Indices of the other photographs, with the reason."""
        return self.flight.absent_from(self.layout)

    @property
    def pairs(self) -> tuple[Pair, ...]:
        """The registration of two photographs; empty for more."""
        return () if self.flight.pair is None else (self.flight.pair,)

    def table(self) -> Table:
        """A row for each photograph that was given, for pandas, polars or `csv`.

        Its centre lies at ``x_px``, ``y_px`` on the canvas, and at ``map_x``, ``map_y`` in metres of the georeference's
        coordinate system; other columns are those of `skymosaic.flight.checking.check.PhotographCheck`. NaN stands for
        what is not known, or of a photograph that is not placed.
        """
        flight, on_map = self.flight, self.composition.place.georeference
        checked = zip(flight.sources, check_flight(flight).photographs, strict=True)
        checks = {source.index: check for source, check in checked}
        middles = {each.source.index: (np.array([each.size]) - 1) / 2 for each in self.composition.placements}
        unread = PhotographCheck("", links=0, overlap=0.0, sharpness=np.nan, clipped=np.nan, gps=False, problems=())
        rows = []
        for index, name in enumerate(flight.names):
            place, metres = np.full((1, 2), np.nan), np.full((1, 2), np.nan)
            if index in middles:
                place = apply(self.transforms[index], middles[index])
                metres = metres if on_map is None else apply(on_map.to_map, place)
            row = {"photograph": name, "placed": index in middles, "reason": self.left_out.get(index, "")}
            row |= dict(zip(("x_px", "y_px", "map_x", "map_y"), (*place[0], *metres[0]), strict=True))
            measures = ("links", "overlap", "sharpness", "clipped", "gps", "error_px", "error_90_px")
            rows.append(row | {measure: getattr(checks.get(index, unread), measure) for measure in measures})
        return tabulate(rows)

    def save(
        self, path: str | Path, *, overwrite: bool = False, require_map: bool = False, sources: bool = False
    ) -> None:
        """Write the mosaic; for a map, as a ``.tif`` is where its place is known, it is rendered again.

        Photographs given as files are read again then, so they must still be there; key frames of a video are not.

        Parameters
        ----------
        path : str or Path
            ``.png``, ``.tif``, ``.mbtiles``, ``.kmz`` ...; by others than ``.tif``, 8 bits are shown.
        overwrite : bool
            Whether an existing file may be replaced.
        require_map : bool
            Whether a mosaic that would not lie on the map is an error.
        sources : bool
            Whether to write which photograph each pixel shows, beside ``mosaic.tif`` as ``mosaic.sources.tif``.

        Raises
        ------
        InputError
            If the file cannot be written, or can be no map although one is required.
        RegistrationError
            If a map is required and the place is not known; the message says why.
        """
        path = Path(path)
        files = [file for source in self.flight.sources for file in source.files]
        form = OutputForm(require_map=require_map, sources=sources)
        form.check(path, len(self.composition.band_names))
        check_size(path, self.composition.size)
        for each in (path, *((sources_of(path),) if sources else ())):
            check_output(each, files, overwrite=overwrite)
        if form.needs_place(path):
            require_place(path, self.composition.place)
        if not (format_of(path).on_map or sources):
            save(path, self.composition.in_8_bit(self.image))
            record_output(path, self.flight.folders)
            return
        try:
            with Workers() as workers:
                bands = self.composition.bands(workers)
                made = deliver(path, self.flight, self.layout, self.composition, bands, form=form)
        finally:
            forget_decoded()
        if made.failures:
            raise InputError("; ".join(made.failures))

    def _repr_html_(self) -> str:
        """The mosaic, reduced, for notebooks."""
        return describe_in_html(repr(self), self.composition.in_8_bit(self.image))

    def __repr__(self) -> str:
        """One line with the size and the counts."""
        height_px, width_px = self.image.shape[:2]
        absent = f", {len(self.left_out)} left out" if self.left_out else ""
        return f"Mosaic({width_px}x{height_px} px, {len(self.placed)} photographs{absent})"
