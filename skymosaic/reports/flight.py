"""The report of a flight: one page with its mosaics, the graph of its links, the photographs left out, the numbers."""

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from golden_model.arrays import Points
from skymosaic.common.options import respell
from skymosaic.flight.checking.check import FlightCheck, check_flight, layout_errors
from skymosaic.flight.flight import Flight
from skymosaic.flight.layout.extent import common_ground
from skymosaic.flight.layout.layout import Layout
from skymosaic.flight.layout.self_calibration import Calibration
from skymosaic.flight.picture.output import PREVIEW_WIDTH_PX, Delivery
from skymosaic.flight.picture.relief import bending_numbers
from skymosaic.imagery.images import reduce_to_width, save
from skymosaic.imagery.own_outputs import record_output
from skymosaic.reports import pages
from skymosaic.reports.footprints import outline_photographs, write_fly_again, write_footprints
from skymosaic.reports.pair import write_pair_report
from skymosaic.reports.summary import describe_mosaic, ground_error_m, list_files, on_white, summarise, summary_rows

MAX_FLAT_RELIEF = 0.05
"""Ground counts as flat if less than this share of the matches lies off the plane."""
_STRONG_TIES = 200
"""Links with this many ties or more are drawn as the strongest."""


def write_report(folder: Path, flight: Flight, deliveries: Sequence[Delivery]) -> None:
    """Write the report of a mosaic: a pair's for two photographs, a flight's for more.

    Parameters
    ----------
    folder : Path
        Created if it is missing.
    deliveries : sequence of Delivery
        Its mosaics, the largest first. Empty if it could not be linked: a pair's report then shows why.
    """
    if flight.pair is not None:
        write_pair_report(folder, flight.pair, on_white(deliveries[0]) if deliveries else None)
    elif deliveries:
        write_flight_report(folder, deliveries, check_flight(flight))
    # Among the photographs, the pictures are none of them.
    for path in pages.list_own_pictures(folder):
        record_output(path, flight.folders)


def write_flight_report(folder: Path, deliveries: Sequence[Delivery], check: FlightCheck) -> None:
    """Write previews, places, ``report.json`` and ``index.html`` of a checked flight; ``deliveries`` is not empty."""
    numbers = flight_numbers(deliveries, check)
    with pages.staged_report(folder) as staged:
        for number, delivery in enumerate(deliveries, start=1):
            save(staged / f"mosaic_{number}.jpg", reduce_to_width(on_white(delivery), PREVIEW_WIDTH_PX)[0])
            if delivery.georeference is not None:
                write_footprints(staged / f"footprints_{number}", delivery)
        write_fly_again(staged / "fly_again", deliveries[0])
        if (mask := deliveries[0].flight.found_mask) is not None:
            save(staged / "mask.png", mask)
        files = list_files(deliveries, folder, staged)
        pages.write_report_files(staged, numbers, _render_page(deliveries, check, numbers, files))


def flight_numbers(deliveries: Sequence[Delivery], check: FlightCheck) -> dict[str, Any]:
    """Collect all numbers and texts of the report, ready for JSON."""
    flight = deliveries[0].flight
    return {
        "photographs": len(flight.names),
        "left_out": {
            flight.short_names[flight.names[index]]: flight.shorten(reason)
            for index, reason in sorted(flight.left_out.items())
        },
        "notes": [flight.shorten(f"{view.name}: {note}") for view in flight.views for note in view.notes],
        "pairs_tried": len(flight.links),
        "links": sum(link.holds for link in flight.links),
        "seconds": {stage: round(value, 3) for stage, value in flight.seconds.items()},
        "lens": None if flight.calibration is None else _lens_numbers(flight.calibration),
        "mosaics": [_mosaic_numbers(delivery) for delivery in deliveries],
        "check": dataclasses.asdict(check),
        "backend": flight.settings.backend,
        "working_width_px": flight.settings.working_width_px,
        **flight.settings.config.rules_summary(),
        "configuration": dataclasses.asdict(flight.settings.config),
    }


def _lens_numbers(estimate: Calibration) -> dict[str, float]:
    errors = {"held_out_before_px": round(estimate.before_px, 3), "held_out_after_px": round(estimate.after_px, 3)}
    return estimate.lens.numbers | errors


def _mosaic_numbers(delivery: Delivery) -> dict[str, Any]:
    layout, flight, composition = delivery.layout, delivery.flight, delivery.composition
    fitted, errors, values = np.concatenate(layout.errors_px), layout_errors(flight, layout), composition.values
    return {
        "file": delivery.path.name,
        "size": list(composition.size),
        **summarise(delivery),
        "placed": len(layout.members),
        "reference": flight.view_names[layout.reference],
        "model": layout.model,
        "model_reason": layout.reason,
        "relief": round(layout.relief, 4),
        "median_error_px": round(layout.median_error_px, 4),
        "error_90_percent_px": round(float(np.percentile(fitted, 90)), 4),
        "overlaps": layout.agreement.numbers,
        "independent_errors": None if errors is None else dataclasses.asdict(errors),
        "transforms": {
            flight.short_names[placement.source.name]: transform.tolist()
            for placement, transform in zip(composition.placements, composition.transforms, strict=True)
        },
        "bent": bending_numbers(flight, layout),
        "reduced": composition.reduced,
        "uneven": composition.uneven,
        "cut_off": {flight.short_names[name]: round(share, 4) for name, share in composition.cut_off.items()},
        "links": [_link_numbers(flight, layout, row) for row in range(len(layout.links))],
        "contradicting": [[flight.view_names[end] for end in (x.left, x.right)] for x in layout.contradicting],
        **_map_numbers(delivery),
        "map_note": delivery.map_note,
        "bands": list(composition.band_names),
        "band_error_px": {name: round(error, 3) for name, error in composition.aligned_px.items()},
        "value_range": values and {"low": values.low, "high": values.high, "kept_in_tif": values.deep},
        "seconds": round(delivery.seconds, 3),
    }


def _map_numbers(delivery: Delivery) -> dict[str, Any]:
    on_map, place, onto = delivery.georeference, delivery.composition.place, delivery.flight.onto
    if on_map is None:
        return {"crs": None}
    offsets = {name: round(m, 3) for name, m in zip(place.fitted_to, on_map.offsets_m, strict=True) if np.isfinite(m)}
    return {
        "crs": on_map.crs,
        "canvas_to_map": on_map.to_map.tolist(),
        "metres_a_pixel": on_map.metres_per_pixel,
        "fitted_to": place.by,
        "onto": onto and onto.description,
        "residual_m": round(on_map.residual_m, 3),
        "residual_of_all_m": round(on_map.residual_of_all_m, 3),
        "scale_error_95": None if np.isnan(on_map.scale_error) else round(on_map.scale_error, 6),
        "offsets_m": offsets,
        "check_points_m": {name: round(m, 3) for name, m in place.checked_m.items()},
        "left_out": [name for name, _ in delivery.composition.place.disagreeing],
        "median_error_m": round(ground_error_m(delivery), 4),
        "height_m": place.height_m,
        "recorded_height_m": place.recorded_height_m,
        "turned_from_recorded_yaw_deg": place.turned_deg,
        "contradictions": list(place.contradictions),
    }


def _link_numbers(flight: Flight, layout: Layout, row: int) -> dict[str, Any]:
    link = layout.links[row]
    return {
        "left": flight.view_names[link.left],
        "right": flight.view_names[link.right],
        "inliers": link.inliers,
        "ties": link.ties,
        "median_error_px": round(float(np.median(layout.errors_px[row])), 4),
    }


def _render_page(
    deliveries: Sequence[Delivery], check: FlightCheck, numbers: dict[str, Any], files: Sequence[tuple[str, str]]
) -> bytes:
    flight = deliveries[0].flight
    placed = sum(len(delivery.layout.members) for delivery in deliveries)
    rows = [
        ("photographs", f"{len(flight.names)}, {placed} placed"),
        ("pairs", f"{numbers['pairs_tried']} tried, {numbers['links']} linked"),
        ("time", ", ".join(f"{stage} {value:.1f} s" for stage, value in flight.seconds.items())),
    ]
    return pages.render(
        "flight.html",
        title=f"Flight of {len(flight.names)} photographs",
        rows=summary_rows(deliveries[0]),
        files=files,
        details=rows,
        left_out=[respell(flight.shorten(reason)) for reason in flight.left_out.values()],
        advice=[respell(flight.shorten(problem)) for problem in _problems(check)],
        mosaics=[
            {
                "rows": [(name, flight.shorten(value)) for name, value in _mosaic_rows(delivery)],
                "photographs": _photographs_worst_first(delivery),
                "graph": _graph_drawing(delivery),
                "overlaps": _overlaps_drawing(delivery),
                "links": _links_worst_first(delivery),
                "residuals": _residuals_worst_first(delivery),
            }
            for delivery in deliveries
        ],
    )


def _mosaic_rows(delivery: Delivery) -> list[tuple[str, str]]:
    layout, flight = delivery.layout, delivery.flight
    errors = layout_errors(flight, layout)
    ground = "flat" if layout.relief < MAX_FLAT_RELIEF else "with relief: expect breaks at objects above the ground"
    rows = [
        ("file", f"{delivery.path.name}, {delivery.composition.size[0]}x{delivery.composition.size[1]}"),
        ("photographs", str(len(layout.members))),
        ("frame", f"{flight.view_names[layout.reference]}, without its tilt"),
        ("model", f"{layout.model} ({layout.reason})"),
        ("ground", f"{ground} ({layout.relief:.0%} of the matches lie 3 to 12 px off the plane)"),
        ("overlaps", layout.agreement.description),
        ("linked pairs", "unknown: no matches were kept aside" if errors is None else errors.description),
        ("residual of the fit", f"median {layout.median_error_px:.2f} px, without the links that contradict it"),
        ("blending and writing", f"{delivery.seconds:.1f} s"),
    ]
    return rows + list(describe_mosaic(delivery).items())


def _photographs_worst_first(delivery: Delivery) -> list[tuple[str, float, float, int]]:
    """Name, median and 90th percentile of the errors, px, and number of matches that the layout did not use."""
    accuracy = delivery.layout.accuracy
    if accuracy is None:
        return []
    names = delivery.flight.view_names
    return [(names[view], x.median_px, x.ninety_px, x.matches) for view, x in accuracy.photographs.items()]


def _problems(check: FlightCheck) -> list[str]:
    single = [f"{photo.name}: {', '.join(photo.problems)}" for photo in check.photographs if photo.problems]
    return [*check.problems, *single]


def _graph_drawing(delivery: Delivery) -> dict[str, Any]:
    """What the template draws: outlines on the canvas, and links between their centres."""
    layout, composition = delivery.layout, delivery.composition
    shown = delivery.flight.view_names
    outlines = dict(zip(layout.members, outline_photographs(composition), strict=True))
    centres = {member: corners.mean(axis=0).round().astype(int).tolist() for member, corners in outlines.items()}
    lines = []
    for link in (*layout.links, *layout.contradicting):
        (x1, y1), (x2, y2) = centres[link.left], centres[link.right]
        strength = min(1.0, link.ties / _STRONG_TIES)
        colour = "#c33" if link in layout.contradicting else f"hsl(120 {60 * strength:.0f}% 40%)"
        title = f"{shown[link.left]} and {shown[link.right]}: {link.inliers} inliers"
        ends = {"x1": x1, "y1": y1, "x2": x2, "y2": y2}
        lines.append({**ends, "colour": colour, "width": f"{1 + 4 * strength:.1f}", "title": title})
    names = [(Path(shown[member]).stem, x, y) for member, (x, y) in centres.items()]
    # All of them, also where a boundary leaves no picture.
    whole, canvas = composition.whole or composition.canvas, composition.canvas
    box = whole.x_px - canvas.x_px, whole.y_px - canvas.y_px, whole.width_px, whole.height_px
    return {"box": box, "size": composition.size, "outlines": list(outlines.values()), "lines": lines, "names": names}


def _overlaps_drawing(delivery: Delivery) -> list[tuple[str, str, Points]]:
    """Kind, names and outline on the canvas of what each two photographs that were compared have in common.

    Those that disagree come last, so that they lie on top.
    """
    shown, pairs = delivery.flight.view_names, delivery.layout.agreement
    outlines = dict(zip(delivery.layout.members, outline_photographs(delivery.composition), strict=True))
    return [
        (kind, f"{shown[left]} and {shown[right]}", common_ground(outlines[left], outlines[right]))
        for kind, agrees in (("agree", True), ("unknown", None), ("disagree", False))
        for left, right in pairs.of(agrees)
    ]


def _residuals_worst_first(delivery: Delivery) -> list[tuple[str, str, float]]:
    """Name, part in the fit, and distance in metres of each position or control point."""
    on_map, place = delivery.georeference, delivery.composition.place
    if on_map is None:
        return []
    rows = [
        (name, "left out" if index in on_map.disagreeing else "fitted", offset_m)
        for index, (name, offset_m) in enumerate(zip(place.fitted_to, on_map.offsets_m, strict=True))
        if np.isfinite(offset_m)
    ]
    rows += [(name, "check point", offset_m) for name, offset_m in place.checked_m.items()]
    return sorted(rows, key=lambda row: -row[2])


def _links_worst_first(delivery: Delivery) -> list[dict[str, Any]]:
    layout = delivery.layout
    links = [_link_numbers(delivery.flight, layout, row) for row in range(len(layout.links))]
    return sorted(links, key=lambda link: -link["median_error_px"])
