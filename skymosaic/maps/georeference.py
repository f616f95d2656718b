"""Positions on the map in metres, and the similarity that places a mosaic there."""

from __future__ import annotations

import contextlib
import math
import warnings
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import rasterio
import rasterio.errors
import rasterio.warp
from numpy.typing import ArrayLike, NDArray
from rasterio._err import CPLE_BaseError

from golden_model.arrays import Array, Matrix, Points
from skymosaic.common.errors import InputError
from skymosaic.common.later import Later
from skymosaic.geometry.homography import DegenerateError, estimate_similarity, transfer_error
from skymosaic.imagery.exif import Position

MIN_POSITIONS = 3
"""Two positions fit a similarity exactly, so a wrong one would go unnoticed."""
MAX_RESIDUAL = 0.25
"""A fit is refused if its residual is larger than this share of the spread of the positions."""
MAX_DISAGREEING = 1 / 3
"""A fit is refused if a larger share of the positions disagrees with it."""
MIN_GSD_M = 1e-5
"""A fit with less on the ground per pixel is refused: such coordinates are degrees, or of another unit."""
MIN_SPREAD_M = 0.1
"""Nor are positions that spread less: not even RTK places cameras by them."""
FAR_OFF = 3.0
"""A position disagrees if its offset is more than this many times the median, which noise does once in 500, ..."""
NEGLIGIBLE = 2e-3
"""... and more than this share of the spread of the positions."""
MAX_TRIALS = 500
REFITS = 5
LAGS = (0.0, 1.0, 3.0, 10.0, 30.0, 100.0)
"""Shots after which the errors of positions have forgotten themselves; each is as likely before they are seen. Those of
receivers drift, so that a strip may be shifted, turned or stretched as a whole."""
WRONG = 0.05
"""Share of positions that are wrong before any are seen."""
EXACT_M = 1e-6
"""No position is known better."""
CONFIDENCE = 0.95
"""Share of cases in which the scale is true within what is said of it."""
MIRRORED = "; mirrored, they fit: check the signs (S, W), the order of x and y, and whether photographs are mirrored"
MUCH_BETTER = 0.1
"""Positions are mirrored if that leaves a smaller share of their offsets; some three that are right have 0.2."""
ROUNDING = 1e-9
WORST_NAMED = 5
GDAL_CACHE_BYTES = 64 << 20
"""By default GDAL takes a twentieth of the machine's memory, and so holds most of a large mosaic once more."""


@dataclass(frozen=True, eq=False)
class Georeference:
    """Position of a mosaic on the map."""

    crs: str
    """The map's coordinate system as rasterio reads it, for instance EPSG:32615; in metres."""
    to_map: Matrix
    """Pixels, centres at integers, to metres east and north: a similarity."""
    residual_m: float
    """Root mean square distance of the agreeing positions from their places on the map."""
    offsets_m: tuple[float, ...] = ()
    """Distance of each position from its place on the map, NaN without a position."""
    disagreeing: tuple[int, ...] = ()
    """Indices of positions too far off, which the fit leaves out."""
    scale_error: float = math.nan
    """The scale is true within this share of it in 95 % of cases; NaN for two positions."""

    @property
    def residual_of_all_m(self) -> float:
        """Root mean square distance of all positions from their places on the map, those left out included."""
        return _rms(self.offsets_m)

    @property
    def metres_per_pixel(self) -> float:
        """Ground resolution, the length of a pixel's side."""
        return math.hypot(*self.to_map[:2, 0])

    @property
    def transform(self) -> rasterio.Affine:
        """The same as a raster's transformation, whose pixels begin at the outer corner of the first."""
        corner = self.to_map @ np.array([[1, 0, -0.5], [0, 1, -0.5], [0, 0, 1]])
        return rasterio.Affine(*corner[:2].ravel())

    def for_pixels(self, to_pixels: Matrix) -> Georeference:
        """The georeference of other pixels, given their map ``to_pixels`` to these pixels."""
        to_map = np.asarray(self.to_map @ to_pixels, dtype=np.float64)
        step_m = math.hypot(*to_map[:2, 0])
        if abs(to_map[0, 0] - step_m) + abs(to_map[1, 0]) < ROUNDING * step_m:
            # North is up. Programs treat a raster as turned even if rounding errors alone turn it.
            to_map[:2, :2] = np.diag([step_m, -step_m])
        return replace(self, to_map=to_map)


@contextlib.contextmanager
def configured_rasterio() -> Iterator[None]:
    """Context with a small cache for GDAL, and without rasterio's warnings about files without a georeference."""
    with warnings.catch_warnings(), rasterio.Env(GDAL_CACHEMAX=GDAL_CACHE_BYTES):
        warnings.simplefilter("ignore", rasterio.errors.NotGeoreferencedWarning)
        yield


def map_to_globe(points: Points, crs: str) -> Points:
    """Longitudes and latitudes (N, 2) on WGS 84 of positions on the map."""
    return reproject(points, crs, "EPSG:4326")


def reproject(points: Points, source: str, target: str) -> Points:
    """Convert positions (N, 2), x first, from one coordinate system to another.

    Raises
    ------
    InputError
        For an unknown system, or positions that it cannot express.
    """
    try:
        x, y = np.asarray(points).reshape(-1, 2).T.tolist()
        return np.column_stack(rasterio.warp.transform(source, target, x, y))
    # For a place where a projection ends, rasterio passes on GDAL's own error.
    except (rasterio.errors.RasterioError, rasterio.errors.CRSError, CPLE_BaseError) as error:
        raise InputError(f"{source} to {target}: {error}; check the coordinate system") from None


def project_to_utm(positions: Sequence[Position]) -> tuple[str, Points]:
    """Project positions to the UTM zone of most of them; returns its name and (N, 2) metres east and north."""
    # Not of the first: a wrong one, which a fit leaves out, would still stretch the map.
    ((crs, _),) = Counter(map(_utm_zone, positions)).most_common(1)
    return crs, project(positions, crs)


def project(positions: Sequence[Position], crs: str) -> Points:
    """Project positions to metres (N, 2) on the map of most of them; those that it cannot show lie about as far off."""
    degrees = np.array([position.degrees for position in positions])
    # What is off the map is an error or infinite, by what PROJ has computed before.
    with contextlib.suppress(InputError):
        if np.isfinite(projected := reproject(degrees, "EPSG:4326", crs)).all():
            return projected
    metres = np.full(degrees.shape, np.nan)
    for index in range(len(positions)):
        with contextlib.suppress(InputError):
            metres[index] = reproject(degrees[index], "EPSG:4326", crs)
    known = np.isfinite(metres).all(axis=1)
    # A fit names what is far off; NaN would be no position at all.
    first = int(np.argmax(known))
    for index in np.flatnonzero(~known).tolist():
        metres[index] = metres[first] + positions[index].metres_from(positions[first])
    return metres


def _utm_zone(position: Position) -> str:
    # A longitude of exactly 180 degrees belongs to zone 1.
    zone = int((position.longitude_deg + 180) // 6) % 60 + 1
    return f"EPSG:{(32700 if position.latitude_deg < 0 else 32600) + zone}"


def fit_to_map(
    points: Points,
    metres: Points,
    crs: str,
    names: Sequence[str] | None = None,
    *,
    tolerances_m: Array | float = 0.0,
    in_time: bool = True,
) -> tuple[Georeference | None, str]:
    """Fit a similarity from pixels (N, 2) to the map (N, 2), metres east and north; what is far off is left out.

    Metres are NaN where they are unknown. Of few positions, offsets up to ``tolerances_m``, one or (N,), are no
    disagreement. Errors of positions taken one after the other, ``in_time``, may drift. Returns also why there is no
    georeference, with the names of the places; empty if there is one.
    """
    known = np.flatnonzero(np.isfinite(metres).all(axis=1))
    # With two photographs there is no third position to check the fit; the caller has to say so.
    fewest = min(MIN_POSITIONS, max(len(points), 2))
    if len(known) < fewest:
        return None, f"{len(known)} of {len(points)} photographs have GPS; {fewest} are needed"
    # Rows count downwards and north points up. A similarity cannot mirror, so y is negated before the fit.
    upright, targets = points[known] * [1.0, -1.0], metres[known]
    tolerances_m = np.broadcast_to(tolerances_m, len(points))[known]
    agreeing, similarity, offsets, refusal = _fit_most(upright, targets, tolerances_m)
    _, _, offsets_mirrored, refusal_mirrored = _fit_most(upright * [-1.0, 1.0], targets, tolerances_m)
    # Few positions may fit either way, as those of a straight strip do: then one way is not so much better.
    if not refusal and not refusal_mirrored and _rms(offsets_mirrored) + EXACT_M < MUCH_BETTER * _rms(offsets):
        refusal = f"positions and layout differ by {offsets.max():.1f} m at most"
    if refusal:
        farthest = known[np.argsort(-offsets)][:WORST_NAMED].tolist()
        worst = ", ".join(str(index) if names is None else names[index] for index in farthest)
        off = f"; farthest off: {worst}" if worst else ""
        return None, refusal + off + ("" if refusal_mirrored else MIRRORED)
    all_offsets = np.full(len(points), np.nan)
    all_offsets[known] = offsets
    residual = _rms(offsets[agreeing])
    to_map = similarity @ np.diag([1.0, -1.0, 1.0])
    disagreeing = tuple(known[~agreeing].tolist())
    lags = LAGS if in_time else LAGS[:1]
    scale_error = _scale_error(upright, targets, known, agreeing, farthest_m=offsets.max(), lags=lags)
    return Georeference(crs, to_map, residual, tuple(all_offsets.tolist()), disagreeing, scale_error), ""


def _scale_error(
    points: Points,
    targets: Points,
    order: NDArray[np.intp],
    agreeing: NDArray[np.bool_],
    *,
    farthest_m: float,
    lags: Sequence[float],
) -> float:
    """Share of the scale of a similarity within which the true one lies in 95 % of cases; NaN for two positions.

    Errors may be correlated over any of ``lags``, and positions that do not agree may be wrong, each anywhere up to
    ``farthest_m`` off, or as good as the others. Each case is weighed by how well it explains all positions (restricted
    likelihood, Patterson and Thompson 1971), and tells how far the scale may be off. Independent errors are lag 0.
    """
    if len(points) == 2:
        return math.nan
    fits = []
    for chosen in (agreeing, np.ones(len(points), dtype=bool))[: 1 + (not agreeing.all())]:
        # On complex numbers, w = a + b z is a similarity.
        z, w = ((each[chosen] - each[agreeing].mean(axis=0)) @ [1, 1j] for each in (points, targets))
        wrong = (~chosen).sum() * (math.log(WRONG) - 2 * math.log(max(farthest_m, EXACT_M)))
        for lag in lags:
            slope, sigma, likelihood = _fit_drifting(z, w, np.diff(order[chosen]), lag)
            fits.append((slope, sigma / abs(slope), likelihood + wrong, 2 * len(z) - 4))
    slopes, sigmas, likelihoods, free = map(np.array, zip(*fits, strict=True))
    # The fit is that of positions that agree, with independent errors.
    off = (slopes / slopes[0]).real - 1
    weights = np.exp(likelihoods - likelihoods.max())
    weights /= weights.sum()

    special = Later("scipy.special")

    def excess(share: float) -> float:
        inside = special.stdtr(free, (share - off) / sigmas) - special.stdtr(free, (-share - off) / sigmas)
        return float(weights @ inside) - CONFIDENCE

    most = np.abs(off).max() + (special.stdtrit(free, (1 + CONFIDENCE) / 2) * sigmas).max()
    return float(Later("scipy.optimize").brentq(excess, 0, 2 * most))


def _fit_drifting(z: Points, w: Points, steps: NDArray[np.intp], lag: float) -> tuple[complex, float, float]:
    """Slope b of w = a + b z, whose errors are correlated over ``lag``, its standard deviation, and the likelihood."""
    columns, free = np.column_stack((np.ones(len(z)), z, w)), 2 * len(z) - 4
    kept = np.exp(-steps / lag)[:, None] if lag else np.zeros((len(z) - 1, 1))
    # What each error brings that the one before does not tell: these are independent.
    new = np.concatenate((columns[:1], (columns[1:] - kept * columns[:-1]) / np.sqrt(1 - kept**2)))
    design, seen = new[:, :2], new[:, 2]
    normal = design.conj().T @ design
    found = np.linalg.solve(normal, design.conj().T @ seen)
    squares = float((np.abs(seen - design @ found) ** 2).sum()) + EXACT_M**2
    likelihood = math.lgamma(free / 2) - np.log(1 - kept**2).sum() - np.linalg.slogdet(normal)[1]
    sigma = np.sqrt(np.linalg.inv(normal)[1, 1].real * squares / free)
    return complex(found[1]), float(sigma), float(likelihood - free / 2 * np.log(squares))


def _fit_most(points: Points, targets: Points, tolerances_m: Array) -> tuple[NDArray[np.bool_], Array, Array, str]:
    """Which positions agree, their similarity, all offsets, and why this is no fit; that is empty if it is one.

    There are no offsets where none of the positions is to blame.
    """
    try:
        agreeing, similarity = _fit_agreeing(points, targets, tolerances_m)
    except DegenerateError:
        return np.zeros(0, bool), np.eye(3), np.zeros(0), "the positions coincide or do not fit the layout at all"
    offsets, spread, refusal = transfer_error(similarity, points, targets), _spread(targets[agreeing]), ""
    if not (step_m := math.hypot(*similarity[:2, 0])) > MIN_GSD_M:
        refusal = f"{step_m:.1g} m per pixel is finer than any photograph; check the unit of the coordinates"
    elif spread < MIN_SPREAD_M:
        refusal = f"the positions spread over {spread:.2g} m, too little for a map; check their unit"
    if refusal:
        return agreeing, similarity, np.zeros(0), refusal
    if (~agreeing).mean() > MAX_DISAGREEING:
        refusal = (
            f"{(~agreeing).sum()} of {len(agreeing)} positions, more than a third, disagree with the others, "
            f"by {offsets[~agreeing].min():.1f} to {offsets.max():.1f} m"
        )
    elif _rms(offsets[agreeing]) > MAX_RESIDUAL * spread:
        refusal = (
            f"positions and layout differ by {np.median(offsets):.1f} m in the median and {offsets.max():.1f} m at "
            f"most, too much for a spread of {spread:.1f} m"
        )
    return agreeing, similarity, offsets, refusal


def _pairs(count: int) -> Array:
    """Pairs of positions that are tried (N, 2): all of them, or `MAX_TRIALS` at random."""
    if count * (count - 1) // 2 <= MAX_TRIALS:
        return np.stack(np.triu_indices(count, 1), axis=1)
    rng = np.random.default_rng(0)
    first = rng.integers(0, count, MAX_TRIALS)
    return np.stack([first, (first + rng.integers(1, count, MAX_TRIALS)) % count], axis=1)


def _spread(points: Points) -> float:
    """Root mean square distance from the centroid."""
    return _rms(np.linalg.norm(points - points.mean(axis=0), axis=1))


def _rms(offsets: ArrayLike) -> float:
    """Root mean square, without NaN."""
    return float(np.sqrt(np.nanmean(np.square(offsets))))


def _fit_agreeing(points: Points, targets: Points, tolerances_m: Array) -> tuple[NDArray[np.bool_], Array]:
    """Fit the similarity of the positions that agree; returns which do, and the similarity.

    It starts from the two positions with the smallest median offset (least median of squares, Rousseeuw 1984). A fit to
    all of them is no start even where none stands out: a strip that is off by one vector bends it until all look alike.

    Raises
    ------
    DegenerateError
        If no two positions determine a similarity.
    """
    if len(points) <= MIN_POSITIONS:
        # Any two agree exactly, so that noise would make an outlier of the third.
        return np.ones(len(points), dtype=bool), estimate_similarity(points, targets)
    # On complex numbers, w = a + b z is a similarity.
    z, w = points @ [1, 1j], targets @ [1, 1j]
    pairs = _pairs(len(points))
    first, second = pairs[(z[pairs[:, 0]] != z[pairs[:, 1]]) & (w[pairs[:, 0]] != w[pairs[:, 1]])].T
    if len(first) == 0:
        raise DegenerateError("no two positions differ")
    slope = (w[second] - w[first]) / (z[second] - z[first])
    offsets = np.abs(w[first, None] + slope[:, None] * (z - z[first, None]) - w)
    start = int(np.argmin(np.median(offsets, axis=1)))
    chosen = [first[start], second[start]]
    best = estimate_similarity(points[chosen], targets[chosen])
    # Of few positions, the best pair fits half closer than the noise (Rousseeuw and Leroy 1987). Of four or five, it
    # fits them almost exactly, so that what is known of the noise counts, too; of many, they say it themselves.
    few = 5 / (len(points) - 2)
    far_off, tolerances_m = FAR_OFF * (1 + few), min(few, 1) * tolerances_m
    for _ in range(REFITS):
        offsets = transfer_error(best, points, targets)
        limit = max(far_off * float(np.median(offsets)), NEGLIGIBLE * _spread(targets))
        agreeing = offsets <= np.maximum(limit, tolerances_m)
        best = estimate_similarity(points[agreeing], targets[agreeing])
    return agreeing, best
