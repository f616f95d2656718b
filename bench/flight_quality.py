"""Mosaics whose truth nobody knows: their errors by independent ties, and how they look.

**Errors** holds what the report of a flight says against ties that had no part in its layout.

SIFT, at 1600 px and with fixed parameters and seed, matches photographs that follow each other or that the layout lets
overlap. An epipolar test keeps matches on relief, which no homography explains. The error of a tie is its distance
under the layout, in px of the right photograph at that width. Its part along the baseline, towards the epipole of the
pair's own ties, can be the height of the ground; the part across it is a fault of the layout, the lens or the tie. The
layout's cameras do not say where the baseline is: from a kite, a few degrees of theirs make a fault of height.
"""

import tempfile
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import cv2
import numpy as np
import typer
from rich.console import Console
from rich.progress import track

from bench.methods import match_words, sift_words
from bench.report import Flights, JsonFile, Row, in_process, public_folder, report
from bench.seams import measure_steps
from golden_model.arrays import Array, Intensities, Matrix, Pixels, Points
from golden_model.pixel.gray import to_gray
from sim.scene import Flight as RenderedFlight
from sim.scene import make_lawnmower
from sim.scene.terrain import TERRAINS
from skymosaic.compositing.warp import Canvas, magnification
from skymosaic.flight.flight import Flight
from skymosaic.flight.layout.extent import outline, overlap
from skymosaic.flight.layout.layout import Layout
from skymosaic.geometry.homography import apply, resize_matrix
from skymosaic.imagery.images import reduce_to_width
from skymosaic.mosaicking.api import mosaic, open_run
from skymosaic.mosaicking.options import MosaicOptions, Warp

WIDTH_PX = 1600
"""Width at which errors are given, and SIFT matches."""
FEATURES = 3000
EPIPOLAR_PX = 1.5
MIN_TIES = 30
PARTNERS = 3
"""Each photograph is matched with so many that overlap it most, and with the next two wherever they are."""
WORST = 3
RENDERED = ("flat", *TERRAINS)
SEED, IMAGES, SIZE_PX = 7, 16, (800, 600)
"""Of rendered flights."""
JPEG_QUALITY = 95
"""Of rendered photographs."""
COMPARED_WIDTH_PX = 800
SHARPNESS_SIDE_PX = 384
HIGH_PASS_PX = 6.0


@dataclass(frozen=True, eq=False)
class PairOfTies:
    """Two photographs, by their indices, and ties in px of the photographs at `WIDTH_PX`."""

    left: int
    right: int
    left_points: Points
    right_points: Points


def errors(
    flights: Annotated[list[str], typer.Argument(help=f"Folders of photographs, or of: {', '.join(RENDERED)}.")],
    warp: Annotated[Warp, typer.Option(help="As of `skymosaic mosaic`.")] = "auto",
    json_file: JsonFile = None,
) -> None:
    """Errors as the report says them, and as independent ties show them, px at 1600 px wide.

    Of a rendered flight also those of the true poses: across the baseline, that is what the ties themselves are off.
    Steps at seams are px of the mosaic: median, 90th percentile, and the share above 3 px.
    """
    rows = []
    for name in flights:
        with photographs_of(name) as (folder, truth):
            with open_run([folder], MosaicOptions(warp=warp)) as run:
                flight, layout = run.flight, run.layouts[0]
                steps_px = measure_steps(flight, layout)
                steps = "{:.1f} {:.1f}".format(*np.percentile(steps_px, (50, 90))) + f", {np.mean(steps_px > 3):.0%}"
            meshes, pairs = ", with meshes" if layout.bent else "", find_ties(flight, layout)
            rows.append(error_row(folder.name + meshes, flight, layout, pairs) | {"steps at seams": steps})
        if truth is not None and not layout.bent:
            true = {m: np.linalg.inv(truth.homographies[m]) @ flight.views[m].to_original for m in layout.members}
            row = error_row(f"{folder.name}, true poses", flight, replace(layout, transforms=true), pairs)
            rows.append(row | {"steps at seams": ""})
    report("errors by independent ties", rows, json_file, keep_others=True)


@contextmanager
def photographs_of(flight: str) -> Iterator[tuple[Path, RenderedFlight | None]]:
    """The folder of a flight; one of `RENDERED` is rendered, and comes with its poses."""
    if flight not in RENDERED:
        yield public_folder(flight), None
        return
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary) / f"rendered {flight}"
        folder.mkdir()
        rendered = make_lawnmower(SEED, IMAGES, SIZE_PX, terrain=flight.removeprefix("flat"))
        write_images(folder, rendered.images)
        yield folder, rendered


def error_row(name: str, flight: Flight, layout: Layout, pairs: Sequence[PairOfTies]) -> Row:
    """A flight's errors."""
    by_pair = tie_errors(flight, layout, pairs)
    along, across = np.abs(np.concatenate(by_pair)).T
    middles = np.array([np.median(np.linalg.norm(each, axis=1)) for each in by_pair])
    worst = np.argsort(-middles)[:WORST].tolist()
    median, ninety = np.percentile(np.hypot(along, across), (50, 90))
    names = [Path(view.name).stem for view in flight.views]
    # Ours are in px of the working image; a narrower photograph is not enlarged for SIFT.
    sizes = [(view.size[0], view.working_size[0]) for view in (flight.views[member] for member in layout.members)]
    wide = min(WIDTH_PX, max(whole for whole, _ in sizes)) / max(working for _, working in sizes)
    ours = () if layout.accuracy is None else (layout.accuracy.whole.median_px, layout.accuracy.whole.ninety_px)
    return {
        "flight": name,
        "placed": f"{len(layout.members)} of {len(flight.names)}",
        "contradicting": f"{len(layout.contradicting)} of {len(layout.links) + len(layout.contradicting)}",
        "reported, median and 90 %": " ".join(f"{wide * error:.2f}" for error in ours),
        "independent": f"{median:.2f} {ninety:.2f}",
        "along the baseline": "{:.2f} {:.2f}".format(*np.percentile(along, (50, 90))),
        "across": "{:.2f} {:.2f}".format(*np.percentile(across, (50, 90))),
        "ratio": " ".join(f"{wide * error / truth:.2f}" for error, truth in zip(ours, (median, ninety), strict=False)),
        "pairs above 10 px": f"{np.count_nonzero(middles > 10)} of {len(middles)}",
        "worst pairs": ", ".join(
            f"{names[pairs[row].left]}-{names[pairs[row].right]} {middles[row]:.0f}" for row in worst
        ),
    }


def find_ties(flight: Flight, layout: Layout) -> list[PairOfTies]:
    """The ties of all pairs that show the same ground by SIFT."""
    words, to_original = {}, dict[int, Matrix]()
    for member in track(layout.members, "SIFT", console=Console(stderr=True), transient=True):
        photograph = flight.sources[member].read_photograph(flight.lens)
        reduced, to_original[member] = reduce_to_width(to_gray(photograph.pixels), WIDTH_PX)
        words[member] = sift_words(reduced, FEATURES)

    def bend(member: int, points: Points) -> Points:
        """Where the mosaic's photograph, which a mesh may warp, shows points."""
        bent = layout.bend(member, flight.views[member], apply(to_original[member], points))
        return apply(np.asarray(np.linalg.inv(to_original[member])), bent)

    pairs = []
    for left, right in track(likely_pairs(flight, layout), "ties", console=Console(stderr=True), transient=True):
        left_points, right_points = match_words(words[left], words[right])
        kept = on_epipolar_lines(left_points, right_points)
        if np.count_nonzero(kept) >= MIN_TIES:
            pairs.append(PairOfTies(left, right, bend(left, left_points[kept]), bend(right, right_points[kept])))
    return pairs


def likely_pairs(flight: Flight, layout: Layout) -> list[tuple[int, int]]:
    """Pairs that follow each other, or that the layout lets overlap."""
    outlines = {member: outline(flight.views[member], layout.transforms[member]) for member in layout.members}
    pairs = set()
    for member in layout.members:
        shares = {other: overlap(outlines[member], outlines[other]) for other in layout.members if other != member}
        most = sorted(shares, key=lambda other: -shares[other])[:PARTNERS]
        near = [other for other in (member + 1, member + 2) if other in shares]
        pairs |= {(min(member, other), max(member, other)) for other in (*most, *near)}
    return sorted(pairs)


def on_epipolar_lines(left: Points, right: Points) -> Array:
    """Which matches one fundamental matrix explains, (N,) bool; the same on every run."""
    if len(left) < MIN_TIES:
        return np.zeros(len(left), np.bool_)
    cv2.setRNGSeed(1)
    F, kept = cv2.findFundamentalMat(left, right, cv2.USAC_MAGSAC, EPIPOLAR_PX, 0.999, 2000)
    return np.zeros(len(left), np.bool_) if F is None else kept.ravel() > 0


def tie_errors(flight: Flight, layout: Layout, pairs: Sequence[PairOfTies]) -> list[Array]:
    """Error of each tie of each pair under a layout, along and across the baseline, px: (N, 2) for each pair."""
    errors, frames = [], dict[int, Matrix]()
    for member, matrix in layout.to_reference(flight.views).items():
        blank = np.zeros(flight.views[member].size[::-1], np.uint8)
        frames[member] = matrix @ reduce_to_width(blank, WIDTH_PX)[1]
    for pair in pairs:
        moved = apply(np.linalg.inv(frames[pair.right]) @ frames[pair.left], pair.left_points)
        F, _ = cv2.findFundamentalMat(pair.left_points, pair.right_points, cv2.FM_8POINT)
        *epipole, depth = np.linalg.svd(F)[0][:, -1]
        # The epipole may be at infinity.
        along = moved * depth - epipole
        along /= np.linalg.norm(along, axis=1, keepdims=True)
        off = moved - pair.right_points
        errors.append(np.column_stack(((off * along).sum(axis=1), off[:, 0] * along[:, 1] - off[:, 1] * along[:, 0])))
    return errors


def write_images(folder: Path, images: Iterable[Pixels]) -> list[str]:
    """Write photographs as JPEG; returns their names."""
    names = []
    for index, image in enumerate(images):
        names.append(f"{index:05}.jpg")
        cv2.imwrite(str(folder / names[-1]), image, (cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY))
    return names


def quality(flights: Flights, json_file: JsonFile = None) -> None:
    """Quality of mosaics without ground truth.

    Error: median of the tie points at 1600 px wide. Brightness kept: the mosaic's against the photograph's, with the
    smallest and largest. Burnt: pixels that are white in the mosaic and not
    in the photograph. Misfit: mean absolute difference from the photograph once both have the same mean and contrast.
    NCC: correlation with the photograph after a high-pass, with the tenth percentile; what is out of place lowers it.
    Sharp: energy of fine detail against the photograph warped by a Lanczos kernel, which keeps nearly all.
    """
    rows = [in_process(quality_row, public_folder(flight).resolve()) for flight in flights]
    report("quality of mosaics", rows, json_file)


def quality_row(folder: Path) -> Row:
    """A flight's medians and extremes."""
    with tempfile.TemporaryDirectory() as cache:
        made = mosaic([folder], cache=Path(cache))
    flight, composition = made.flight, made.composition
    shown, measures = _in_colour(made.image), []
    for placement, transform in zip(composition.placements, composition.transforms, strict=True):
        # Of 16 bits, too, as they are: the program's own pictures for the front end have another contrast.
        photograph = flight.lens.straighten(np.asarray(cv2.imread(placement.source.name), np.uint8))
        if placement.mesh is not None:
            places = placement.mesh.places(placement.size, np.eye(3), Canvas(0, 0, *placement.size))
            photograph = cv2.remap(photograph, places, None, cv2.INTER_LANCZOS4, borderMode=cv2.BORDER_REPLICATE)
        if row := measure_photograph(shown, np.asarray(photograph, np.uint8), transform):
            measures.append(row)
    kept, burnt, misfit, ncc, sharp = np.array(measures).T
    return {
        "flight": folder.name,
        "placed": f"{len(made.placed)} of {len(flight.names)}",
        "error, px": f"{WIDTH_PX / flight.settings.working_width_px * made.layout.median_error_px:.2f}",
        "brightness kept": f"{np.median(kept):.2f} ({kept.min():.2f}, {kept.max():.2f})",
        "burnt, %": f"{100 * burnt.mean():.2f}",
        "misfit, %": f"{100 * np.median(misfit):.1f}",
        "NCC": f"{np.median(ncc):.2f} ({np.quantile(ncc, 0.1):.2f})",
        "sharp": f"{np.nanmedian(sharp):.2f}",
    }


def _in_colour(pixels: Intensities) -> Pixels:
    shown = pixels if pixels.dtype == np.uint8 else (pixels >> 8).astype(np.uint8)
    return np.asarray(shown if shown.ndim == 3 else np.dstack([shown] * 3), dtype=np.uint8)


def measure_photograph(mosaic: Pixels, photograph: Pixels, to_mosaic: Matrix) -> tuple[float, ...] | None:
    """The measures of one photograph; None where the mosaic shows less than half of it."""
    scale = COMPARED_WIDTH_PX / photograph.shape[1]
    small = cv2.resize(photograph, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    # Reduced first: warping down by a large factor without it would alias.
    factor = max(1, round(1 / scale / magnification((photograph.shape[1], photograph.shape[0]), to_mosaic)))
    reduced = cv2.resize(mosaic, None, fx=1 / factor, fy=1 / factor, interpolation=cv2.INTER_AREA)
    back = resize_matrix(scale) @ np.linalg.inv(to_mosaic) @ np.linalg.inv(resize_matrix(1 / factor))
    warped = cv2.warpPerspective(reduced, back, small.shape[1::-1], flags=cv2.INTER_LINEAR)
    valid = warped.sum(axis=2) > 0
    if valid.mean() < 0.5:
        return None
    kept = float(warped[valid].mean() / small[valid].mean())
    burnt = float((warped[valid].min(axis=1) > 250).mean() - (small[valid].min(axis=1) > 250).mean())
    a, b = (cv2.cvtColor(part, cv2.COLOR_BGR2GRAY).astype(np.float32) for part in (warped, small))
    fitted = (a - a[valid].mean()) * b[valid].std() / max(a[valid].std(), 1e-6) + b[valid].mean()
    misfit = float(np.abs(fitted - b)[valid].mean() / b[valid].mean())
    inside = cv2.erode(valid.astype(np.uint8), np.ones((25, 25), np.uint8)) > 0
    high = [plane - cv2.GaussianBlur(plane, (0, 0), HIGH_PASS_PX) for plane in (a, b)]
    ncc = float(np.corrcoef(high[0][inside], high[1][inside])[0, 1])
    return kept, burnt, misfit, ncc, sharpness(mosaic, photograph, to_mosaic)


def sharpness(mosaic: Pixels, photograph: Pixels, to_mosaic: Matrix) -> float:
    """Laplacian energy in a window around the photograph's centre, relative to the local mean; NaN off the mosaic."""
    side = SHARPNESS_SIDE_PX
    centre = to_mosaic @ np.array([photograph.shape[1] / 2, photograph.shape[0] / 2, 1.0])
    x, y = (centre[:2] / centre[2] - side / 2).round().astype(int)
    if min(x, y) < 0 or y + side > len(mosaic) or x + side > mosaic.shape[1]:
        return float("nan")
    window = mosaic[y : y + side, x : x + side]
    to_window = np.array([[1, 0, -x], [0, 1, -y], [0, 0, 1]]) @ to_mosaic
    best = cv2.warpPerspective(photograph, to_window, (side, side), flags=cv2.INTER_LANCZOS4)
    grays = (cv2.cvtColor(each, cv2.COLOR_BGR2GRAY).astype(np.float32) for each in (window, best))
    energy, possible = (float((cv2.Laplacian(gray, cv2.CV_32F) ** 2).mean() / gray.mean() ** 2) for gray in grays)
    return energy / max(possible, 1e-9)
