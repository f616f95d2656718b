"""Lays out a flight: from many photographs to the pose of each on the ground."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from golden_model.arrays import Array
from golden_model.cache import Cache
from skymosaic.common.errors import InputError
from skymosaic.common.stopwatch import Stopwatch
from skymosaic.features.given_matches import GivenMatches
from skymosaic.flight.flight import Flight
from skymosaic.flight.layout.agreement import Agreement, find_false_joint, measure_agreement
from skymosaic.flight.layout.layout import MAX_RELIEF, Layout, lay_out
from skymosaic.flight.layout.linked_group import groups
from skymosaic.flight.layout.self_calibration import Calibration, calibrate, straighten_links
from skymosaic.flight.linking.links import Candidate, Link, valid_links
from skymosaic.flight.linking.surveyor import Surveyor
from skymosaic.flight.linking.view import Settings, View
from skymosaic.flight.mapping.anchoring import fit_layout
from skymosaic.flight.mapping.onto import tie_to_map
from skymosaic.flight.pairing.belonging import find_strangers
from skymosaic.flight.pairing.candidates import predicted
from skymosaic.flight.pairing.linked_views import LinkedViews, link_all
from skymosaic.flight.pairing.own_mask import mask_own
from skymosaic.geometry.ground import MOVES_WITH_CAMERA
from skymosaic.geometry.prosac import MIN_INLIERS
from skymosaic.imagery.photographs import Source
from skymosaic.maps.base_map import BaseMap
from skymosaic.maps.control_points import ControlPoints
from skymosaic.maps.positions import Fix, Positions
from skymosaic.running.workers import Workers


def survey(
    sources: Sequence[Source],
    settings: Settings,
    seed: int,
    workers: Workers,
    cache: Cache,
    *,
    positions: Positions | None = None,
    control: ControlPoints | None = None,
    onto: BaseMap | None = None,
    keep_all: bool = False,
    given: Mapping[Candidate, GivenMatches] | None = None,
) -> Flight:
    """Lay out a flight: features, links, lens, layouts (none where none can be made), and their place on the map.

    Parameters
    ----------
    sources : sequence of Source
        In any order; fewer pairs have to be tried in the order of the flight.
    settings, seed, workers, cache
        As in `Surveyor`.
    positions : Positions or None
        Where the cameras were, instead of what the photographs contain.
    control : ControlPoints or None
        Surveyed points, instead of positions.
    onto : BaseMap or None
        A map onto which it is laid where the photographs register with it.
    keep_all : bool
        Whether to take what differs from the other photographs in several properties.
    given : mapping of pair to GivenMatches, or None
        Matches of the user's, by the indices of two sources, the smaller first; other pairs are matched by features.

    Raises
    ------
    InputError
        For fewer than two photographs, if none of them can be used, or for positions of other photographs.
    """
    fixes = None if positions is None else positions.find([source.name for source in sources])
    if len(sources) < 2:
        raise InputError(f"a mosaic takes at least two photographs, not {len(sources)}")
    clock = Stopwatch()
    linked, left_out = _describe(Surveyor(settings, seed, workers, cache), sources, fixes, keep_all=keep_all)
    clock.lap("features")
    rows = {source.index: row for row, source in enumerate(linked.sources)}
    own = {(rows[i], rows[j]): matches for (i, j), matches in (given or {}).items() if {i, j} <= rows.keys()}
    linked = mask_own(link_all(replace(linked, surveyor=replace(linked.surveyor, given=own))))
    clock.lap("pairs")
    surveyor, lens = linked.surveyor, linked.surveyor.settings.lens
    parts = sorted(linked.groups, key=partial(_rank, linked.views))
    calibration = None
    workers.progress("lens", 0, 0)
    # A lens that was given is trusted: photographs through it are straight already.
    if lens.matrix is None:
        calibration = calibrate(linked.views, parts[0], valid_links(linked.links), lens.mask, cache)
    if calibration is not None:
        linked = _straighten(linked, calibration)
    clock.lap("lens")
    workers.progress("layout", 0, 0)
    links, views = dict(linked.links), surveyor.fetch_thumbnails(linked.views)
    look = partial(measure_agreement, views)
    layouts, alone = lay_out_all(linked.views, parts, links, partial(_link_nearby, linked), look)
    clock.lap("layout")
    for view, reason in alone.items():
        why = reason or why_alone(view, views, links.values())
        left_out[linked.sources[view].index] = f"{views[view].name}: {why}"
    flight = Flight(
        names=tuple(source.name for source in sources),
        sources=linked.sources,
        views=views,
        links=tuple(links.values()),
        layouts=tuple(layouts),
        left_out=left_out,
        settings=surveyor.settings,
        seconds=clock.seconds,
        calibration=calibration,
        found_mask=lens.mask if settings.lens.mask is None else None,
        positions="" if positions is None else positions.name,
    )
    flight = replace(flight, layouts=tuple(fit_layout(flight, layout, control) for layout in layouts))
    if onto is None:
        return flight
    flight = replace(flight, onto=tie_to_map(onto, flight, control, seed, workers))
    clock.lap("map")
    return replace(flight, layouts=tuple(fit_layout(flight, layout, control) for layout in flight.layouts))


def _describe(
    surveyor: Surveyor, sources: Sequence[Source], fixes: Sequence[Fix | None] | None, *, keep_all: bool
) -> tuple[LinkedViews, dict[int, str]]:
    """The photographs of a flight, not linked yet, and why the other sources are left out, by index."""
    views, left_out = _read(surveyor, sources)
    if not keep_all:
        read = list(views)
        for view, reason in find_strangers(list(views.values())).items():
            left_out[read[view].index] = reason
            del views[read[view]]
    if fixes is not None:
        views = {source: _with_fix(view, fixes[source.index]) for source, view in views.items()}
    return LinkedViews(surveyor, tuple(views), tuple(views.values()), {}), left_out


def _with_fix(view: View, fix: Fix | None) -> View:
    """The same view with a position from a file in place of the camera's own; None is no position."""
    position, accuracy_m = (None, None) if fix is None else (fix.position, fix.accuracy_m)
    taken = replace(view.taken, position=position, accuracy_m=accuracy_m, own_position=view.gps)
    return replace(view, taken=taken)


def _read(surveyor: Surveyor, sources: Sequence[Source]) -> tuple[dict[Source, View], dict[int, str]]:
    """The views of sources that can be used and do not repeat another, and why the rest is left out, by index."""
    distinct: dict[str, Source] = {}
    left_out: dict[int, str] = {}
    for source in sources:
        try:
            same = distinct.setdefault(source.digest, source)
        except InputError as error:
            left_out[source.index] = str(error)
            continue
        # The same content twice would make a perfect link that says nothing about the ground.
        if same is not source:
            left_out[source.index] = f"{source.name}: the same photograph as {same.name}"
    views: dict[Source, View] = {}
    for source, view in zip(distinct.values(), surveyor.describe(list(distinct.values())), strict=True):
        if isinstance(view, str):
            left_out[source.index] = view
            continue
        try:
            surveyor.settings.lens.check(view.size, source.name)
            views[source] = view
        except InputError as error:
            left_out[source.index] = str(error)
    if not views:
        raise InputError(f"none of the {len(sources)} photographs can be used: {next(iter(left_out.values()))}")
    return views, left_out


def _straighten(linked: LinkedViews, calibration: Calibration) -> LinkedViews:
    """The photographs and their ties as a camera without distortion would have shown them.

    Those of another camera, which no link joins to these, stay as they are.
    """
    settings = replace(linked.surveyor.settings, lens=calibration.lens)
    surveyor = replace(linked.surveyor, settings=settings)
    through = [index for index, view in enumerate(linked.views) if calibration.lens.fits(view.size)]
    distortion = dict.fromkeys(through, calibration.distortion)
    links = straighten_links(valid_links(linked.links), linked.views, distortion)
    return replace(linked, surveyor=surveyor, views=surveyor.straighten(linked.views), links={**linked.links, **links})


def lay_out_all(
    views: Sequence[View],
    parts: Sequence[list[int]],
    links: dict[Candidate, Link],
    link_nearby: Callable[[Layout], dict[Candidate, Link]],
    look: Callable[[Mapping[int, Array], Sequence[Link]], Agreement],
) -> tuple[list[Layout], dict[int, str]]:
    """The layouts of all parts of a flight, and the views that are in none of them, with the reason if it is known.

    What ``link_nearby`` finds by a layout is added to ``links``, and the layout is made again. Where the ground, at
    which ``look`` looks, contradicts what joins two parts of it, each is laid out by itself.
    """
    layouts: list[Layout] = []
    apart: dict[int, str] = {}
    reasons = dict.fromkeys(range(len(views)), "")
    todo = list(parts)
    while todo:
        members = todo.pop(0)
        if len(members) == 1:
            continue
        layout = lay_out(views, members, valid_links(links))
        reasons |= layout.misplaced
        if nearby := link_nearby(layout):
            layout = _lay_out_again(views, layout, links, nearby)
            reasons |= layout.misplaced
        if layout.fault:
            reasons |= dict.fromkeys(layout.members, layout.fault)
        elif len(layout.members) > 1:
            agreement = look(layout.transforms, layout.links)
            # What is no plane looks different from each side.
            flat = layout.relief <= MAX_RELIEF
            if flat and (false := find_false_joint(agreement, layout.members, layout.links, links)):
                part, reason = false
                apart |= dict.fromkeys(part, reason)
                reasons |= dict.fromkeys(part, f"it has links to others that {reason}")
                todo += [part, [member for member in layout.members if member not in part]]
            else:
                layouts.append(replace(layout, agreement=agreement, apart=apart.get(layout.members[0], "")))
        # Views whose place is in doubt may still belong together.
        doubtful = [member for member in members if member not in layout.transforms]
        inside = [link for link in valid_links(links) if link.left in doubtful and link.right in doubtful]
        todo += [part for part in groups(len(views), inside) if part[0] in doubtful]
    alone = {view: reason for view, reason in reasons.items() if not any(view in each.transforms for each in layouts)}
    return sorted(layouts, key=lambda layout: _rank(views, layout.members)), alone


def _rank(views: Sequence[View], members: Sequence[int]) -> tuple[int, float]:
    """What sorts groups: most photographs first; of as many, those with most pixels, as of a wide beside a thermal."""
    return -len(members), -float(np.median([np.prod(views[member].size) for member in members]))


def _lay_out_again(
    views: Sequence[View], layout: Layout, links: dict[Candidate, Link], nearby: Mapping[Candidate, Link]
) -> Layout:
    """Make a layout again with the links that it led to, and add to ``links`` those of them that it confirms.

    The others were found by chance. They must neither count as contradictions nor put photographs in doubt.
    """
    again = lay_out(views, layout.members, valid_links({**links, **nearby}), layout)
    confirmed = {pair: link for pair, link in nearby.items() if link in again.links}
    links |= confirmed
    return again if len(confirmed) == len(nearby) else lay_out(views, layout.members, valid_links(links), layout)


def _link_nearby(linked: LinkedViews, layout: Layout) -> dict[Candidate, Link]:
    """Links that hold of pairs that overlap in a layout, although their features alone did not link them."""
    transforms = layout.transforms
    known = {(link.left, link.right): link for link in layout.links}
    # Among repeated textures, a search around a false place would find one more link that confirms it.
    disputed = {view for link in layout.contradicting for view in (link.left, link.right)}
    pairs = predicted(linked.views, transforms, known) if known else set()
    near = {
        (left, right): np.linalg.inv(transforms[right]) @ transforms[left]
        for left, right in pairs
        if disputed.isdisjoint((left, right))
    }
    found = linked.surveyor.link_nearby(linked.views, near)
    return {pair: link for pair, link in found.items() if link.holds}


def why_alone(view: int, views: Sequence[View], links: Iterable[Link]) -> str:
    """Why no link joins a view to the others, with its best match."""
    features = len(views[view].strongest)
    if features < MIN_INLIERS:
        return f"too few features ({features}; flat, blurred or masked image?)"
    tried = [link for link in links if view in (link.left, link.right)]
    if not tried:
        return "no other photograph can be used"
    if held := sum(link.holds for link in tried):
        return f"{held} links contradict each other or the layout, so its place is unknown"
    best = max(tried, key=lambda link: link.inliers)
    if best.moves_with_camera or (not best.inliers and any(link.moves_with_camera for link in tried)):
        others = "it may also be water below a camera that hovers, or what lies far ahead"
        return f"nothing links it to the others; {MOVES_WITH_CAMERA}; `mask` it; {others}"
    other = views[best.left + best.right - view].name
    best_match = f"at best {best.inliers} matches agree, with {other}; {MIN_INLIERS} are needed"
    return f"nothing links it to the others ({best_match})"
