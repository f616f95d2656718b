"""A mosaic in words: what a client asks first, and what else is to be said of it."""

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any
from urllib.parse import quote

import cv2
import numpy as np

from golden_model.arrays import Pixels
from skymosaic.common.provenance import provenance
from skymosaic.compositing.warp import magnification
from skymosaic.flight.checking.check import layout_errors
from skymosaic.flight.picture.composition import Composition
from skymosaic.flight.picture.output import Delivery
from skymosaic.flight.picture.relief import describe_bending

HECTARE_M2 = 10_000
MAX_CUTS = 5
"""So many photographs that are cut off are named."""
OF_SOME_FLIGHTS = {
    "fly_again.kml": "where to fly again for Google Earth",
    "fly_again.geojson": "where to fly again for GIS",
    "mask.png": "mask of what moves with the camera",
}
"""Files that not every report has, and what they are."""


def summarise(delivery: Delivery) -> dict[str, Any]:
    """Area, m², times of the first and the last photograph, and cameras; None where not known."""
    taken = [delivery.flight.views[member].taken for member in delivery.layout.members]
    times = sorted(each.time for each in taken if each.time)
    on_map = delivery.georeference
    return {
        "area_m2": None if on_map is None else round(delivery.covered_px * on_map.metres_per_pixel**2, 1),
        "first_taken": times[0] if times else None,
        "last_taken": times[-1] if times else None,
        "cameras": sorted({each.camera for each in taken if each.camera}),
    }


def summary_rows(delivery: Delivery) -> list[tuple[str, str]]:
    """The same in words, with what is not known left out, and who made the mosaic."""
    facts, on_map = summarise(delivery), delivery.georeference
    width_px, height_px = delivery.composition.size
    rows = [("overlaps", delivery.layout.agreement.description), ("accuracy", describe_accuracy(delivery))]
    if on_map is not None:
        hectares = facts["area_m2"] / HECTARE_M2
        area = f"{hectares:.2f} ha" if hectares >= 1 else f"{facts['area_m2']:.0f} m²"
        rows = [("area", area), ("resolution", f"{100 * on_map.metres_per_pixel:.1f} cm per pixel"), *rows]
    if facts["cameras"]:
        rows.insert(0, ("camera", ", ".join(facts["cameras"])))
    if facts["first_taken"]:
        whole = [facts["first_taken"], facts["last_taken"]]
        end = whole[1].removeprefix(whole[0][:11]) if whole[1][:10] == whole[0][:10] else whole[1]
        rows.insert(0, ("flown", whole[0] if whole[0] == whole[1] else f"{whole[0]} to {end}"))
    made = provenance()
    written = made["written"][:16].replace("T", " ")
    photographs = f"{len(delivery.layout.members)} of {len(delivery.flight.names)} photographs"
    return [
        ("mosaic", f"{delivery.path.name}, {width_px} x {height_px} pixels, {photographs}"),
        *rows,
        ("made by", f"skymosaic {made['version']}, {written} UTC"),
    ]


def describe_accuracy(delivery: Delivery) -> str:
    """How far a mosaic is off, in one sentence without terms of the trade."""
    on_map, place = delivery.georeference, delivery.composition.place
    within = "Half of the points by which photographs are linked meet within"
    if on_map is None:
        errors = layout_errors(delivery.flight, delivery.layout)
        if errors is None:
            return "Not known: no matches were kept aside to measure it."
        return f"{within} {errors.median_px:.1f} pixels."
    within = f"{within} {100 * ground_error_m(delivery):.1f} cm"
    if place.checked_m:
        of_checked = f"{len(place.checked_m)} check points are off by {place.checked_rms_m:.2f} m (root mean square)"
        return f"{within}; {of_checked}."
    return f"{within}; on the map, they fit the {place.by} within {on_map.residual_m:.2f} m."


def describe_mosaic(delivery: Delivery) -> dict[str, str]:
    """What only some mosaics have, in lines, by what each is about."""
    composition = delivery.composition
    lines = {
        "warp": describe_bending(delivery.layout),
        "size": composition.reduced,
        "light": composition.uneven,
        "blurred": delivery.flight.describe_blurred(delivery.layout),
        "cut off": _describe_cuts(delivery) if composition.cut_off else "",
        "bands": _describe_bands(composition) if composition.band_names else "",
        "range": composition.values.description if composition.values else "",
        "map": _describe_map(delivery) if delivery.georeference else "",
        "contradiction": "; ".join(composition.place.contradictions),
        "map note": delivery.map_note,
        "not written": "; ".join(delivery.failures),
    }
    return {about: line for about, line in lines.items() if line}


def _describe_map(delivery: Delivery) -> str:
    """Say in one line where a mosaic lies on the map and how well it fits there."""
    on_map, place = delivery.georeference, delivery.composition.place
    assert on_map is not None
    parts = [f"{on_map.crs}, {on_map.metres_per_pixel:.3g} m per pixel"]
    if delivery.flight.pair is None:
        of_all = f" ({on_map.residual_of_all_m:.2f} m of all)" if on_map.disagreeing else ""
        parts.append(f"{place.by} residual {on_map.residual_m:.2f} m{of_all}")
    if delivery.flight.onto is not None:
        parts.append(delivery.flight.onto.description)
    if place.checked_m:
        parts.append(f"{len(place.checked_m)} check points off by {place.checked_rms_m:.2f} m (root mean square)")
    if np.isfinite(on_map.scale_error):
        parts.append(f"scale ± {on_map.scale_error:.2%}")
    if delivery.layout.median_error_px:
        parts.append(f"layout off by {ground_error_m(delivery):.2g} m in the median")
    if place.height_m is not None and place.recorded_height_m is not None:
        parts.append(f"flown at {place.height_m:.0f} m (recorded: {place.recorded_height_m:.0f} m)")
    if place.turned_deg is not None:
        parts.append(f"turned by {place.turned_deg:.0f} degrees from the recorded yaw")
    if without := place.describe_disagreeing():
        parts.append(f"without {without}")
    return "; ".join(parts)


def _describe_cuts(delivery: Delivery) -> str:
    """Name the photographs that show less than they contain, and how much is cut off, in one line."""
    named, cuts = delivery.flight.short_names, delivery.composition.cut_off
    shares = [f"{named[name]} {share:.0%}" for name, share in cuts.items()]
    # Where all look ahead, all are cut; `report.json` has them.
    others = f" and {len(shares) - MAX_CUTS} more" if len(shares) > MAX_CUTS else ""
    return f"{', '.join(shares[:MAX_CUTS])}{others}: ground towards the horizon, far beyond their matches or too coarse"


def _describe_bands(composition: Composition) -> str:
    """Name the bands of a multi-band mosaic and their errors in one line."""
    registering = next(name for name in composition.band_names if name not in composition.aligned_px)
    others = ", ".join(f"{name} {error:.2f} px" for name, error in composition.aligned_px.items())
    return f"{', '.join(composition.band_names)}; registered by {registering}, median error of the others: {others}"


def ground_error_m(delivery: Delivery) -> float:
    """Median error of the layout on the ground, m."""
    layout, views, composition = delivery.layout, delivery.flight.views, delivery.composition
    assert delivery.georeference is not None
    reference = layout.members.index(layout.reference)
    working_px = np.asarray(composition.transforms[reference] @ views[layout.reference].to_original)
    error_px = layout.median_error_px if layout.accuracy is None else layout.accuracy.whole.median_px
    canvas_px = error_px * magnification(views[layout.reference].working_size, working_px)
    return canvas_px * delivery.georeference.metres_per_pixel


def list_files(deliveries: Sequence[Delivery], folder: Path, staged: Path) -> list[tuple[str, str]]:
    """What was written beside a report in ``folder``, so far in ``staged``: what it is, and its address from there."""
    files = []
    for number, delivery in enumerate(deliveries, start=1):
        of = f" {number}" if len(deliveries) > 1 else ""
        files.append((f"mosaic{of}", _address(delivery.path, folder)))
        if delivery.sources is not None:
            files.append((f"photograph of each pixel{of}", _address(delivery.sources, folder)))
        if delivery.tiles is not None:
            files.append((f"map to zoom{of}", _address(delivery.tiles / "index.html", folder)))
        if delivery.georeference is not None:
            files.append((f"footprints{of} for Google Earth", f"footprints_{number}.kml"))
            files.append((f"footprints{of} for GIS", f"footprints_{number}.geojson"))
    files += [(what, name) for name, what in OF_SOME_FLIGHTS.items() if (staged / name).exists()]
    return [*files, ("all numbers", "report.json")]


def _address(path: Path, folder: Path) -> str:
    # On Windows, nothing leads from one drive to another.
    try:
        return quote(Path(os.path.relpath(path.resolve(), folder.resolve())).as_posix())
    except ValueError:
        return path.resolve().as_uri()


def on_white(delivery: Delivery) -> Pixels:
    """The preview, white instead of black where no photograph shows."""
    missing = 255 - delivery.coverage
    return np.asarray(cv2.add(delivery.preview, missing if delivery.preview.ndim == 2 else cv2.merge([missing] * 3)))
