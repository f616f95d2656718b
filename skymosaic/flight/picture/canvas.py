"""The canvas of a mosaic: which way is up, how large it is, and where each photograph lies on it."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from golden_model.arrays import Array, Matrix, Points
from skymosaic.common.errors import InputError, RegistrationError
from skymosaic.compositing.blend import Blending
from skymosaic.compositing.warp import ROUNDING_PX, Canvas, CanvasError, enclosing_canvas, magnification, outline
from skymosaic.flight.flight import Flight
from skymosaic.flight.layout.extent import least_nearness
from skymosaic.flight.layout.layout import Layout
from skymosaic.flight.mapping.place import MapPlace
from skymosaic.flight.picture.composition import Composition, Placement, Room
from skymosaic.geometry.homography import apply, resize_matrix
from skymosaic.imagery.depth import measure_common_range
from skymosaic.maps.boundary import Boundary, OutsideError
from skymosaic.maps.georeference import Georeference

MIN_GSD = 0.99
"""A ground resolution is refused below this share of the photographs' own: enlarging them shows nothing new."""

NARROW_PX = 2
"""Only in so narrow a canvas may a boundary miss the centres of all pixels."""
THIN = "the boundary is thinner than a pixel of the mosaic; draw an area, or raise `scale`"


def place_on_canvas(
    flight: Flight,
    layout: Layout,
    blending: Blending,
    *,
    scale: float,
    room: Room,
    place: MapPlace,
    boundary: Boundary | None,
) -> Composition:
    """Lay the photographs of a layout on a canvas, without tones and seams; parameters as of `compose`."""
    views = [flight.views[member] for member in layout.members]
    check_scale(scale, [view.size for view in views])
    to_reference = layout.to_reference(flight.views).values()
    on_map, usual = place.georeference, usual_magnification(flight, layout)
    least = list(least_nearness(flight.views, layout.transforms, layout.links, scale).values())

    ends = None
    if boundary is not None:
        shown = zip(views, to_reference, least, strict=True)
        outlines = [apply(each, outline(v.size, each, near)) for v, each, near in shown]
        boundary, ends = _bring_onto(place, boundary, outlines)

    def lay(scale: float) -> tuple[Array, list[Array], Canvas, Canvas]:
        if on_map is not None and flight.pair is None:
            to_canvas = north_up(on_map, on_map.metres_per_pixel * usual / scale, place.grid)
        else:
            to_canvas = resize_matrix(scale / usual)
        transforms = [to_canvas @ transform for transform in to_reference]
        limit_px = math.inf if flight.pair is None else room.area_px
        whole = enclosing_canvas([v.size for v in views], transforms, least, limit_px=limit_px)
        return to_canvas, transforms, whole, whole if ends is None else _cut_off(whole, apply(to_canvas, ends))

    try:
        to_canvas, transforms, whole, canvas = lay(scale)
    except CanvasError as error:
        raise RegistrationError(f"{len(views)} photographs, the first {views[0].name}: {error}") from None
    reduced = ""
    if flight.pair is None and (share := room.share_of(canvas)) < 1:
        full = canvas
        check_scale(scale * share, [view.size for view in views])
        to_canvas, transforms, whole, canvas = lay(scale * share)
        reduced = (
            f"reduced from {full.width_px}x{full.height_px} to {canvas.width_px}x{canvas.height_px} px, because "
            f"{room.reason}; `scale` or `canvas_limit_px` choose the size"
        )
    if on_map is not None:
        on_map = on_map.for_pixels(np.asarray(np.linalg.inv(canvas.translation @ to_canvas)))
        place = replace(place, georeference=on_map)
        shape = canvas.height_px, canvas.width_px
        if boundary is not None and min(shape) <= NARROW_PX and not boundary.mask(shape, on_map.transform).any():
            raise InputError(THIN)
    if flight.pair is None:
        transforms = [whole.translation @ transform for transform in transforms]
        canvas = replace(canvas, x_px=canvas.x_px - whole.x_px, y_px=canvas.y_px - whole.y_px)
        whole = replace(whole, x_px=0, y_px=0)
    placements = tuple(
        Placement(
            flight.sources[member],
            view.size,
            transform,
            least_nearness=nearest,
            mesh=layout.meshes.get(member),
            orientation=view.orientation,
        )
        for member, view, transform, nearest in zip(layout.members, views, transforms, least, strict=True)
    )
    coloured = any(view.thumbnail.ndim == 3 for view in views)
    values = measure_common_range([view.sample for view in views])
    return Composition(
        placements, canvas, coloured, blending, flight.lens, values, place, boundary, whole, reduced=reduced
    )


def _bring_onto(place: MapPlace, boundary: Boundary, outlines: Sequence[Points]) -> tuple[Boundary, Points]:
    """A boundary in the system of a place, and its corners in the reference frame, as are the photographs' outlines."""
    if (on_map := place.georeference) is None:
        raise OutsideError(f"{boundary.name}: the mosaic has no place on the map: {place.note}")
    boundary = boundary.in_system(on_map.crs)
    boundary.share_shown([apply(on_map.to_map, corners) for corners in outlines])
    return boundary, apply(np.asarray(np.linalg.inv(on_map.to_map)), boundary.points)


def _cut_off(whole: Canvas, ends: Points) -> Canvas:
    """The part of a canvas whose pixels the box of a boundary touches."""
    first, end = np.floor(ends.min(axis=0) + 0.5 + ROUNDING_PX), np.ceil(ends.max(axis=0) + 0.5 - ROUNDING_PX)
    (x, y), (width, height) = first.astype(int).tolist(), (end - first).astype(int).tolist()
    if (part := whole.intersection(Canvas(x, y, width, height))) is None:
        raise InputError(THIN)
    return part


def check_scale(scale: float, sizes: Sequence[tuple[int, int]]) -> None:
    """Raise InputError for a scale that leaves no pixel of any photograph."""
    if scale * max(max(size) for size in sizes) < 1:
        raise InputError("a photograph is smaller than a pixel; raise `scale` or `canvas_limit_px`, or lower `gsd_m`")


def north_up(georeference: Georeference, metres_per_pixel: float, grid: Matrix | None = None) -> Matrix:
    """Pixels of a georeference to pixels of a map with north up and ``metres_per_pixel``, (3, 3).

    With the ``grid`` of another map, pixels to metres, they lie on its pixels; where theirs are of another size, their
    corners are at multiples of it.
    """
    to_canvas = np.diag([1 / metres_per_pixel, -1 / metres_per_pixel, 1.0]) @ georeference.to_map
    if grid is not None:
        if math.isclose(math.hypot(*grid[:2, 0]), metres_per_pixel):
            to_canvas = np.linalg.inv(grid) @ georeference.to_map
        else:
            to_canvas[:2] -= 0.5 * to_canvas[2]
    # The origin is arbitrary; small numbers keep their digits.
    to_canvas[:2, 2] -= np.round(to_canvas[:2, 2])
    return np.asarray(to_canvas)


def usual_magnification(flight: Flight, layout: Layout) -> float:
    """Pixels of the reference frame per pixel of the median photograph; 1 of two, whose frame is the right one's.

    The reference may have flown lower or higher than most: a mosaic should neither invent detail nor lose it.
    """
    if flight.pair is not None:
        return 1.0
    transforms = layout.to_reference(flight.views)
    return float(np.median([magnification(flight.views[m].size, each) for m, each in transforms.items()]))


def scale_for(flight: Flight, layout: Layout, on_map: Georeference | None, gsd_m: float) -> float:
    """The scale at which canvas pixels are ``gsd_m`` metres wide.

    Raises
    ------
    InputError
        Without a map, or for a resolution finer than that of the photographs.
    """
    if on_map is None:
        raise InputError("`gsd_m`: the mosaic has no place on the map, so metres are unknown; use `scale` instead")
    finest_m = on_map.metres_per_pixel * usual_magnification(flight, layout)
    if gsd_m < MIN_GSD * finest_m:
        raise InputError(f"`gsd_m` is {gsd_m:g} m, finer than the photographs; give at least {finest_m:.3g}")
    return min(finest_m / gsd_m, 1.0)
