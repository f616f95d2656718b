"""Checks a flight before the pilot leaves: overlap, blur, exposure, GPS and weak links."""

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from skymosaic.flight.flight import BLURRED, Flight
from skymosaic.flight.layout.accuracy import Errors
from skymosaic.flight.layout.extent import outline, overlap
from skymosaic.flight.layout.layout import MAX_RELIEF, Layout
from skymosaic.flight.layout.linked_group import groups
from skymosaic.flight.linking.links import WEAK_TIES, Link
from skymosaic.geometry.ground import MOVES_WITH_CAMERA, STILL
from skymosaic.geometry.homography import apply
from skymosaic.imagery.exif import describe_gps_faults

MIN_BEST_OVERLAP = 0.3
"""Best overlap with any other photograph below which a photograph is poorly tied."""
CLIPPED = 0.2
"""A photograph is badly exposed if more than this share of it is black or white."""
MAX_REDUCED = 2
"""Photographs of one lens that differ more in size have few descriptors in common."""
WEAK_OVERLAP = 0.2
"""A link with less overlap is weak, too."""

MAX_CONTRADICTING = 0.02
"""Share of links that contradict the layout above which it may be wrong: few links of distinct ground are false."""
MAX_ERROR_PX = 10.0
"""Median error beyond which a photograph lies wrong, or shows ground too far from flat for its place in the mosaic."""
MAX_NINETY_SHARE = 0.015
"""90th percentile of the errors, as a share of a photograph's width, beyond which lines break at seams for all to see:
flat ground has 0.005, a hillside 0.02."""
WORST_NAMED = 3


@dataclass(frozen=True)
class PhotographCheck:
    """One photograph of a flight."""

    name: str
    links: int
    """Photographs it is linked with."""
    overlap: float
    """Best overlap with another one, as a share of the smaller; 0 if it is in no mosaic."""
    sharpness: float
    """Relative to photographs of the same ground; 1 is as sharp as they are."""
    clipped: float
    """Share of its pixels that are black or white."""
    gps: bool
    problems: tuple[str, ...]
    error_px: float | None = None
    error_90_px: float | None = None
    """Median and 90th percentile of the errors of its matches that the layout did not use, working px; None where these
    are too few."""


@dataclass(frozen=True)
class LayoutErrors(Errors):
    """Errors of the matches that a layout did not use, with the worst by name."""

    width_px: int
    """Width of the working images."""
    worst_photographs: dict[str, float]
    worst_pairs: dict[str, float]
    """Median errors of those that are farthest off, px."""

    @property
    def description(self) -> str:
        """All of it in one line."""
        photographs, pairs = (
            ", ".join(f"{name} {error_px:.1f}" for name, error_px in worst.items())
            for worst in (self.worst_photographs, self.worst_pairs)
        )
        return (
            f"median {self.median_px:.2f} px, 90 % below {self.ninety_px:.2f} px at {self.width_px} px wide "
            f"({self.matches} matches that the layout did not use); worst: {photographs}; pairs: {pairs}"
        )


@dataclass(frozen=True)
class FlightCheck:
    """A flight as a whole."""

    complete: bool
    """Whether all photographs that can be read make one mosaic."""
    photographs: tuple[PhotographCheck, ...]
    """In the order of the flight, without those that cannot be read."""
    problems: tuple[str, ...]
    """Problems of the whole flight, each with the remedy."""
    errors: tuple[LayoutErrors, ...] = ()
    """Those of each layout, the largest first, where matches were kept aside."""
    overlaps: tuple[dict[str, float | None], ...] = ()
    """`Agreement.numbers` of each layout, the largest first."""


def check_flight(flight: Flight) -> FlightCheck:
    """Find the problems of a flight that was laid out."""
    best = _best_overlaps(flight)
    measured = [layout.accuracy.photographs for layout in flight.layouts if layout.accuracy is not None]
    errors = {view: each for photographs in measured for view, each in photographs.items()}
    links = Counter(end for link in flight.links if link.holds for end in (link.left, link.right))
    photographs = []
    named = zip(flight.views, flight.view_names, flight.relative_sharpness.tolist(), strict=True)
    for index, (view, name, sharpness) in enumerate(named):
        measures = links[index], best[index], sharpness, float(view.clipped.mean() / 255)
        error_px = (errors[index].median_px, errors[index].ninety_px) if index in errors else (None, None)
        has_gps = view.gps is not None
        photographs.append(PhotographCheck(name, *measures, has_gps, _problems(*measures), *error_px))
    whole = len(flight.layouts) == 1 and len(flight.layouts[0].members) == len(flight.views)
    by_layout = tuple(each for layout in flight.layouts if (each := layout_errors(flight, layout)) is not None)
    overlaps = tuple(layout.agreement.numbers for layout in flight.layouts)
    return FlightCheck(whole, tuple(photographs), tuple(_problems_of_all(flight)), by_layout, overlaps)


def layout_errors(flight: Flight, layout: Layout) -> LayoutErrors | None:
    """Errors of the matches that a layout did not use; None where none were kept aside."""
    if (accuracy := layout.accuracy) is None:
        return None
    names = flight.view_names
    photographs, pairs = list(accuracy.photographs.items()), list(accuracy.pairs.items())
    return LayoutErrors(
        **vars(accuracy.whole),
        width_px=_widest_px(flight, layout),
        worst_photographs={names[view]: error.median_px for view, error in photographs[:WORST_NAMED]},
        worst_pairs={f"{names[left]}-{names[right]}": error.median_px for (left, right), error in pairs[:WORST_NAMED]},
    )


def _widest_px(flight: Flight, layout: Layout) -> int:
    return max(flight.views[member].working_size[0] for member in layout.members)


def _overlaps(flight: Flight, layout: Layout) -> dict[Link, float]:
    """Overlap of the two photographs of each link, as a share of the smaller."""
    outlines = {m: outline(flight.views[m], layout.transforms[m]) for m in layout.members}
    return {link: overlap(outlines[link.left], outlines[link.right]) for link in layout.links}


def _best_overlaps(flight: Flight) -> list[float]:
    best = [0.0] * len(flight.views)
    for layout in flight.layouts:
        for link, share in _overlaps(flight, layout).items():
            for end in (link.left, link.right):
                best[end] = max(best[end], share)
    return best


def _problems(links: int, best_overlap: float, sharpness: float, clipped: float) -> tuple[str, ...]:
    problems = []
    if links == 0:
        problems.append("linked with no other photograph")
    elif best_overlap < MIN_BEST_OVERLAP:
        problems.append(f"overlaps others by {best_overlap:.0%} at most")
    if sharpness < BLURRED:
        problems.append("blurred")
    if clipped > CLIPPED:
        problems.append(f"{clipped:.0%} black or white")
    return tuple(problems)


def _problems_of_all(flight: Flight) -> Iterator[str]:
    unusable = len(flight.names) - len(flight.views)
    if unusable:
        yield f"{unusable} of {len(flight.names)} photographs cannot be used or repeat another"
    if moves := describe_moving(flight):
        yield moves
    if len(flight.layouts) > 1:
        sizes = ", ".join(str(len(layout.members)) for layout in flight.layouts)
        yield (
            f"{len(flight.layouts)} groups that no link joins for sure ({sizes} photographs): fly again between them; "
            "where the ground has no texture, fly higher or in better light"
        )
    narrow, wide = (choose((view.working_size[0] for view in flight.views), default=0) for choose in (min, max))
    if wide > MAX_REDUCED * narrow and len({view.taken.focal_half_diagonals for view in flight.views}) == 1:
        yield f"photographs are registered at {narrow} to {wide} px wide: --working-width {narrow} makes them alike"
    for layout in flight.layouts:
        yield from doubts(flight, layout)
        yield from _weakly_linked(flight, layout)
    with_gps = sum(view.gps is not None for view in flight.views)
    if 0 < with_gps < len(flight.views):
        faults = describe_gps_faults([view.taken for view in flight.views])
        missing = f"{len(flight.views) - with_gps} of {len(flight.views)} photographs have no GPS"
        yield f"{missing} that can be used: {faults}" if faults else missing


def describe_moving(flight: Flight) -> str:
    """What moves with the camera and what was done about it, or that the camera did not move; else empty."""
    if flight.found_mask is not None:
        share = float(np.mean(flight.found_mask == 0))
        return f"{MOVES_WITH_CAMERA}: {share:.0%} of each photograph is masked; a report has the mask, for --mask"
    if moving := sum(link.moves_with_camera for link in flight.links):
        return (
            f"{MOVES_WITH_CAMERA}, in {moving} of {len(flight.links)} pairs: --mask hides a display or a border; below "
            "a camera that hovers, it may be water or cars that move, and what lies far ahead of one that flies on "
            "seems to move with it, too"
        )
    if any(_stood_still(flight, layout) for layout in flight.layouts):
        return "all photographs of a group show one place: the camera hovered, or they show nothing but a display"
    return ""


def _stood_still(flight: Flight, layout: Layout) -> bool:
    """Whether the middles of all photographs lie within a hundredth of a photograph's side."""
    sizes = np.array([flight.views[member].working_size for member in layout.members])
    middles = [apply(layout.transforms[member], size / 2) for member, size in zip(layout.members, sizes, strict=True)]
    return bool(np.ptp(middles, axis=0).max() < STILL * sizes.max())


def doubts(flight: Flight, layout: Layout) -> Iterator[str]:
    """A line each where ground differs, links contradict the layout, the scene is no plane, photographs are far off."""
    names = flight.view_names
    if differing := layout.agreement.of(False):
        linked = {(link.left, link.right) for link in layout.links}
        (first, _), *others = Counter(end for pair in differing for end in pair).most_common(WORST_NAMED)
        at = f" near {gps.latitude_deg:.5f}, {gps.longitude_deg:.5f}" if (gps := flight.views[first].gps) else ""
        most = ", ".join([names[first] + at, *(names[view] for view, _ in others)])
        yield (
            f"{len(differing)} pairs of photographs lie on each other and show different ground, "
            f"{len(set(differing) - linked)} of them without a link (most at {most}): look at the mosaic there"
        )
    yield from _repeated(layout)
    false, count = layout.contradicting, len(layout.links) + len(layout.contradicting)
    if len(false) > MAX_CONTRADICTING * count:
        ends = Counter(end for link in false for end in (link.left, link.right))
        worst = ", ".join(names[view] for view, _ in ends.most_common(WORST_NAMED))
        yield f"{len(false)} of {count} links contradict the layout (most at {worst}): look at the mosaic there"
    if (accuracy := layout.accuracy) is None:
        return
    if layout.relief > MAX_RELIEF:
        whole = accuracy.whole
        yield (
            f"the scene is no plane: {layout.relief:.0%} of the matches lie 3 to 12 px off it, and those that the "
            f"layout did not use are off by {whole.median_px:.1f} px, one in ten beyond {whole.ninety_px:.0f} px; "
            "what rises above the ground is displaced or doubled"
        )
    elif (off_px := accuracy.whole.ninety_px) > MAX_NINETY_SHARE * _widest_px(flight, layout):
        yield f"lines may break at seams: one match in ten is off by more than {off_px:.0f} px"
    far_off = [
        f"{names[view]} by {each.median_px:.0f} px"
        for view, each in accuracy.photographs.items()
        if each.median_px > MAX_ERROR_PX
    ]
    if far_off:
        more = f" and {len(far_off) - WORST_NAMED} more" if len(far_off) > WORST_NAMED else ""
        yield f"photographs are off: {', '.join(far_off[:WORST_NAMED])}{more}: look at the mosaic there"


def _repeated(layout: Layout) -> Iterator[str]:
    """A line where the ground looks the same elsewhere, unless loops of links, many and all closed, tell its place."""
    closed = len(layout.links) >= 2 * len(layout.members) and not layout.contradicting
    if len(repeated := layout.agreement.repeated) > len(layout.agreement.of(True)) and not closed:
        yield (
            f"the ground repeats itself: {len(repeated)} of {len(layout.agreement.pairs)} pairs that overlap by half "
            "look the same a step aside, so photographs may lie a step off: look at the mosaic"
        )


def _weakly_linked(flight: Flight, layout: Layout) -> Iterator[str]:
    """A line for each part of a layout that only weak links join to the rest."""
    names = flight.view_names
    for photographs, links, best, share in weak_parts(flight, layout):
        left, right = names[best.left], names[best.right]
        shared = f"{best.ties} matches and {share:.0%} overlap"
        several = f"{links} weak links, the best between " if links > 1 else "the link between "
        are = "photograph is" if photographs == 1 else "photographs are"
        yield f"{photographs} {are} joined only by {several}{left} and {right} with {shared}: fly again there"


def weak_parts(flight: Flight, layout: Layout) -> Iterator[tuple[int, int, Link, float]]:
    """The parts of a layout that only weak links join to the rest.

    Of each, how many photographs it has and how many links join it, the best of these, and its overlap.
    """
    overlaps = _overlaps(flight, layout)
    strong = [link for link in layout.links if link.ties >= WEAK_TIES and overlaps[link] >= WEAK_OVERLAP]
    inside = set(layout.members)
    parts = [part for part in groups(len(flight.views), strong) if inside.issuperset(part)]
    named: set[Link] = set()
    for part in parts[1:]:
        across = [link for link in layout.links if (link.left in part) != (link.right in part)]
        best = max(across, key=lambda link: link.ties)
        # Two parts may hang on the same link.
        if best in named:
            continue
        named.add(best)
        yield len(part), len(across), best, overlaps[best]
