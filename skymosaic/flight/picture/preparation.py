"""Prepares the picture of a layout: its canvas, exposure and seams, from thumbnails alone."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from golden_model.arrays import Intensities
from skymosaic.common.memory import release_free_memory
from skymosaic.compositing.blend import Blending
from skymosaic.compositing.exposure import describe_uneven, estimate_levels, estimate_tones, measure_toned_range
from skymosaic.compositing.layer import Layer
from skymosaic.compositing.palette import have_palette
from skymosaic.compositing.seams import NOTHING, find_allowed, find_seams
from skymosaic.compositing.warp import magnification
from skymosaic.flight.flight import BLURRED, Flight
from skymosaic.flight.layout.layout import Layout
from skymosaic.flight.linking.view import View
from skymosaic.flight.mapping.place import NOWHERE, MapPlace
from skymosaic.flight.picture.canvas import place_on_canvas, scale_for, usual_magnification
from skymosaic.flight.picture.composition import Composition, Room
from skymosaic.geometry.homography import resize_matrix
from skymosaic.imagery.depth import ValueRange
from skymosaic.maps.boundary import Boundary

BLURRED_FAVOUR = 1e-3
"""Weight of a blurred photograph: it loses almost every pixel to a sharp one, and still shows where it is alone."""
PALETTE = (
    "brightness: the photographs show a quantity by a palette, as thermal cameras do, and are left as they are: gains "
    "would make colours that mean nothing. Where each has a range of its own, the same ground has several colours; fix "
    "the range in the camera, or export gray TIFFs of 16 bits"
)


def compose(
    flight: Flight,
    layout: Layout,
    *,
    blending: Blending | None = None,
    scale: float = 1.0,
    room: Room | None = None,
    place: MapPlace = NOWHERE,
    gsd_m: float | None = None,
    boundary: Boundary | None = None,
) -> Composition:
    """Prepare the picture of one layout, from thumbnails alone.

    Two photographs are blended as they are, in the frame of the right one. More of them get a canvas that begins at
    (0, 0) of its own frame, in which north is up where there is a map; equal exposure; blurred photographs show only
    where no other does; and multi-band blending is cut along seams.

    Parameters
    ----------
    flight, layout
        The layout is one of the flight's.
    blending : {"average", "distance", "multiband"} or None
        See `skymosaic.compositing.blend.blend_layers`; None: distance for two photographs, multiband for more.
    scale : float
        Canvas pixels per pixel of the median photograph; for two photographs, per pixel of the right one.
    room : Room
        What the canvas may become. That of a flight is reduced to it; of two photographs, a larger one is refused.
    place : MapPlace
        Place on the map; its georeference is that of the layout's reference frame.
    gsd_m : float or None
        Metres on the ground per canvas pixel, instead of ``scale``.
    boundary : Boundary or None
        Where the picture ends; inside, it is that of the whole mosaic.

    Raises
    ------
    InputError
        For a ``gsd_m`` without a map, or finer than the photographs; for a scale that leaves no pixel of a photograph;
        for a boundary without a map, or of ground that no photograph shows.
    RegistrationError
        For two photographs, if the canvas would be too large, or one reaches behind the horizon.
    """
    # Averages of the ten photographs that may show the same ground would be blurred.
    blending = blending or ("multiband" if flight.pair is None else "distance")
    if gsd_m is not None:
        scale = scale_for(flight, layout, place.georeference, gsd_m)
    elif place.georeference is not None and place.grid is not None:
        finest_m = place.georeference.metres_per_pixel * usual_magnification(flight, layout)
        scale = finest_m / math.hypot(*place.grid[:2, 0])
    composition = place_on_canvas(
        flight, layout, blending, scale=scale, room=room or Room(), place=place, boundary=boundary
    )
    if flight.pair is not None:
        return composition
    sharpness = flight.relative_sharpness[list(layout.members)]
    composition = composition.with_each(favour=[BLURRED_FAVOUR if value < BLURRED else 1.0 for value in sharpness])
    views = [flight.views[member] for member in layout.members]
    # Exposure and seams are smooth, so thumbnails that are in memory already decide both; nothing is decoded here.
    thumbnails, reduction = thumbnail_layers(composition, views)
    if blending != "multiband":
        return equalise(composition, views, thumbnails)
    allowed = find_allowed(thumbnails)
    thumbnails = [thumbnails[index] for index in allowed]
    some = replace(composition, placements=tuple(composition.placements[index] for index in allowed))
    some = equalise(some, [views[index] for index in allowed], thumbnails)
    release_free_memory()
    # Seams run where neighbours look alike, so they are cut through thumbnails of equal exposure.
    toned = [replace(layer, tone=p.tone) for layer, p in zip(thumbnails, some.placements, strict=True)]
    some = some.with_each(seam=find_seams(toned, allowed.values(), reduction, some.values))
    placements = [replace(placement, seam=NOTHING) for placement in composition.placements]
    for index, placement in zip(allowed, some.placements, strict=True):
        placements[index] = placement
    return replace(some, placements=tuple(placements))


def equalise(composition: Composition, views: Sequence[View], thumbnails: Sequence[Layer]) -> Composition:
    """Set the tones of all placements, and for photographs of 16 bits the value range that the tones need.

    Photographs with the colours of a palette keep them. Each placement has one of ``views`` and of `thumbnail_layers`.
    """
    values = composition.values
    if values is None and have_palette([layer.image for layer in thumbnails]):
        return replace(composition, uneven=PALETTE)
    if values is None or not values.deep:
        tones, drift = estimate_tones(thumbnails)
    else:
        samples = [view.sample for view in views]
        black, white = estimate_levels(samples, [view.taken.black_level for view in views])
        tones, drift = estimate_tones(thumbnails, black=black, white=white)
        values = measure_toned_range(tones, samples, values)
    uneven = describe_uneven(thumbnails, tones, drift)
    return replace(composition.with_each(tone=tones), values=values, uneven=uneven)


def thumbnail_layers(composition: Composition, views: Sequence[View]) -> tuple[list[Layer], float]:
    """The thumbnails of all placements as layers of a reduced canvas, in colour, and the scale of that canvas."""
    # The canvas is reduced as the widest photograph is, so that hardly any thumbnail is enlarged; but where it is small
    # already, because one photograph shows very much ground, it stays as it is.
    widest = max(views, key=lambda view: view.size[0])
    enlarged = float(np.median([magnification(p.size, p.transform) for p in composition.placements]))
    reduction = min(1.0, widest.thumbnail.shape[1] / widest.size[0] / enlarged)
    layers = []
    for view, placement in zip(views, composition.placements, strict=True):
        from_thumbnail = view.to_original @ np.linalg.inv(view.to_thumbnail)
        lens, size = composition.lens.turned(view.orientation), (view.thumbnail.shape[1], view.thumbnail.shape[0])
        layers.append(
            Layer(
                image=_coloured_thumbnail(view, composition.values),
                transform=resize_matrix(reduction) @ placement.transform @ from_thumbnail,
                visible=lens.visible_mask(size, view.visible),
                clipped=None if view.value_range else view.clipped,
                # Thumbnails have the same size, whatever detail their photographs show.
                favour=placement.favour * view.size[0] / view.thumbnail.shape[1],
                least_nearness=placement.least_nearness,
                mesh=placement.mesh,
            )
        )
    return layers, reduction


def _coloured_thumbnail(view: View, values: ValueRange | None) -> Intensities:
    """A thumbnail in colour: with the camera's numbers where the mosaic has 16 bits, else as ``values`` shows it."""
    pixels = view.thumbnail if view.thumbnail.ndim == 3 else np.dstack([view.thumbnail] * 3)
    if values is None or view.value_range is None:
        return pixels
    return view.value_range.to_16_bit(pixels) if values.deep else view.value_range.show_as(pixels, values)
