"""Lays out a flight: from many photographs to the pose of each on the ground."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from golden_model.arrays import Array
from skymosaic.common.errors import InputError
from skymosaic.common.stopwatch import Stopwatch
from skymosaic.flight.flight import Flight
from skymosaic.flight.layout.layout import Layout, lay_out, rough_transforms
from skymosaic.flight.layout.linked_group import groups
from skymosaic.flight.layout.self_calibration import (
    Calibration,
    calibrate,
    measure_remaining_distortion,
    straighten_links,
)
from skymosaic.flight.linking.links import RELIEF_PX, Candidate, Link, valid_links
from skymosaic.flight.linking.surveyor import Surveyor
from skymosaic.flight.linking.view import Settings, View
from skymosaic.flight.mapping.anchoring import fit_layout
from skymosaic.flight.pairing import candidates
from skymosaic.flight.pairing.belonging import find_strangers
from skymosaic.flight.pairing.own_mask import find_mask
from skymosaic.flight.pairing.second_look import link_across_heights, link_by_coarse_detail, link_by_more_features
from skymosaic.geometry.ground import MOVES_WITH_CAMERA
from skymosaic.geometry.homography import transfer_error
from skymosaic.geometry.prosac import MIN_INLIERS
from skymosaic.imagery.photographs import Source
from skymosaic.maps.control_points import ControlPoints
from skymosaic.maps.positions import Fix, Positions
from skymosaic.running.cache import ResultCache
from skymosaic.running.workers import Workers

MAX_ROUNDS = 6
"""How often a better layout may propose further pairs."""


def survey(
    sources: Sequence[Source],
    settings: Settings,
    seed: int,
    workers: Workers,
    cache: ResultCache,
    *,
    positions: Positions | None = None,
    control: ControlPoints | None = None,
    keep_all: bool = False,
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
    keep_all : bool
        Whether to take what differs from the other photographs in several properties.

    Raises
    ------
    InputError
        For fewer than two photographs, if none of them can be used, or for positions of other photographs.
    """
    fixes = None if positions is None else positions.find([source.name for source in sources])
    if len(sources) < 2:
        raise InputError(f"a mosaic takes at least two photographs, not {len(sources)}")
    clock = Stopwatch()
    surveyor = Surveyor(settings, seed, workers, cache)
    usable, views, left_out = _describe(surveyor, sources)
    strangers = {} if keep_all else find_strangers(views)
    left_out |= {usable[view].index: reason for view, reason in strangers.items()}
    usable = tuple(source for view, source in enumerate(usable) if view not in strangers)
    views = tuple(each for view, each in enumerate(views) if view not in strangers)
    if fixes is not None:
        views = tuple(_with_fix(view, fixes[source.index]) for source, view in zip(usable, views, strict=True))
    clock.lap("features")
    links = _link(surveyor, usable, views)
    masked = _mask_own(surveyor, usable, views, links)
    if masked is not None:
        surveyor, views, links = masked
        settings = surveyor.settings
    clock.lap("pairs")
    parts = sorted(groups(len(views), valid_links(links)), key=partial(_rank, views))
    calibration, remaining = None, dict[int, Array]()
    workers.progress("lens", 0, 0)
    # A lens that was given is trusted: photographs through it are straight already.
    if settings.lens.matrix is None:
        calibration = calibrate(views, parts[0], valid_links(links), settings.lens.mask, cache)
    if calibration is not None:
        views = tuple(view.light if calibration.lens.fits(view.size) else view for view in views)
        views, links, remaining = _straighten(surveyor, usable, views, links, members=parts[0], calibration=calibration)
        calibration = calibration.with_remaining(remaining[parts[0][0]])
    clock.lap("lens")
    workers.progress("layout", 0, 0)
    link_nearby = partial(_link_nearby, surveyor, views, remaining)
    layouts, alone = lay_out_all(views, parts, links, link_nearby)
    views = surveyor.fetch_thumbnails(views)
    clock.lap("layout")
    for view, reason in alone.items():
        left_out[usable[view].index] = f"{views[view].name}: {reason or _why_alone(view, views, links.values())}"
    flight = Flight(
        names=tuple(source.name for source in sources),
        sources=usable,
        views=views,
        links=tuple(links.values()),
        layouts=tuple(layouts),
        left_out=left_out,
        settings=settings,
        seconds=clock.seconds,
        calibration=calibration,
        found_mask=None if masked is None else settings.lens.mask,
        positions="" if positions is None else positions.name,
    )
    return replace(flight, layouts=tuple(fit_layout(flight, layout, control) for layout in layouts))


def _with_fix(view: View, fix: Fix | None) -> View:
    """The same view with a position from a file in place of the camera's own; None is no position."""
    position, accuracy_m = (None, None) if fix is None else (fix.position, fix.accuracy_m)
    taken = replace(view.taken, position=position, accuracy_m=accuracy_m, own_position=view.gps)
    return replace(view, taken=taken)


def _describe(
    surveyor: Surveyor, sources: Sequence[Source]
) -> tuple[tuple[Source, ...], tuple[View, ...], dict[int, str]]:
    """All sources that can be used and do not repeat another, their views, and why the rest is left out, by index."""
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
    return tuple(views), tuple(views.values()), left_out


def _link(surveyor: Surveyor, sources: Sequence[Source], views: Sequence[View]) -> dict[Candidate, Link]:
    """Link likely pairs, then what the layout predicts; groups that stay isolated get a second look."""
    votes = surveyor.count_votes(views)
    links = surveyor.link(views, candidates.first_candidates(views, votes))
    _add_predicted(surveyor, views, links)
    # Thumbnails last: they serve only the groups that more features could not join.
    links |= link_by_more_features(surveyor, sources, views, links, votes)
    links |= link_across_heights(surveyor, views, links)
    links |= link_by_coarse_detail(surveyor, views, links)
    _add_predicted(surveyor, views, links)
    return links


def _mask_own(
    surveyor: Surveyor, sources: Sequence[Source], views: Sequence[View], links: dict[Candidate, Link]
) -> tuple[Surveyor, tuple[View, ...], dict[Candidate, Link]] | None:
    """Views and links again without what moves with the camera, as a mask from a file would give them.

    Where its groups would be smaller, the mask is for the picture alone. None where a lens is given, or nothing moves
    with the camera.
    """
    lens, moving = surveyor.settings.lens, _moving_links(views, links)
    if lens.mask is not None or lens.matrix is not None or not moving:
        return None
    mask = find_mask(views, moving, [view.thumbnail for view in surveyor.fetch_thumbnails(views)])
    if mask is None:
        return None
    surveyor = replace(surveyor, settings=replace(surveyor.settings, lens=replace(lens, mask=mask)))
    described = surveyor.describe_all(sources)
    again = tuple(replace(view, taken=known.taken) for view, known in zip(described, views, strict=True))
    found = _link(surveyor, sources, again)
    before, after = ([len(part) for part in groups(len(views), valid_links(each))] for each in (links, found))
    if after >= before and after[0] > 1:
        return surveyor, again, found
    return (surveyor, tuple(views), links) if before[0] >= len(views) / 2 else None


def _moving_links(views: Sequence[View], links: Mapping[Candidate, Link]) -> list[Link]:
    """The links with matches that move with the camera, unless the layout of the others says that they do not."""
    moving, valid = [link for link in links.values() if link.moves_with_camera], valid_links(links)
    parts = [part for part in groups(len(views), valid) if len(part) > 2] if moving else []
    rough = [rough_transforms(views, part, valid) for part in parts]
    return [link for link in moving if not any(_explains(transforms, link) for transforms in rough)]


def _explains(transforms: Mapping[int, Array], link: Link) -> bool:
    """Whether by a layout the matches that were taken for moving are ground, as below a camera that hovers."""
    if link.left not in transforms or link.right not in transforms:
        return False
    to_right = np.linalg.inv(transforms[link.right]) @ transforms[link.left]
    return bool(np.median(transfer_error(to_right, link.left_moving, link.right_moving)) < RELIEF_PX)


def _add_predicted(surveyor: Surveyor, views: Sequence[View], links: dict[Candidate, Link]) -> None:
    """Add links that the present layout predicts: closed loops, and neighbours that were not candidates before."""
    for _ in range(MAX_ROUNDS):
        valid = valid_links(links)
        # Two views overlap by their link already; a layout of three or more can predict another one.
        rough = [rough_transforms(views, part, valid) for part in groups(len(views), valid) if len(part) > 2]
        pairs = {pair for transforms in rough for pair in candidates.predicted(views, transforms, links)}
        if not pairs:
            return
        links |= surveyor.link(views, pairs)


def _straighten(
    surveyor: Surveyor,
    sources: Sequence[Source],
    views: Sequence[View],
    links: Mapping[Candidate, Link],
    *,
    members: Sequence[int],
    calibration: Calibration,
) -> tuple[tuple[View, ...], dict[Candidate, Link], dict[int, Array]]:
    """Describe and link the photographs again without their distortion, and measure what distortion remains in each.

    Near the border of a distorted photograph a corner looks different from what it is in the middle of a neighbour, and
    its position is off, so features are computed anew. Where the new ones do not link two views, the old ties stay.
    """
    surveyor = replace(surveyor, settings=replace(surveyor.settings, lens=calibration.lens))
    # Photographs of another camera, which no link joins to these, stay as they are.
    through = [index for index, view in enumerate(views) if calibration.lens.fits(view.size)]
    # Nor is another photograph read in the place of one that was replaced meanwhile; it will be left out.
    through = [index for index in through if not sources[index].change]
    straight_views = list(views)
    for index, view in zip(through, surveyor.describe_all([sources[index] for index in through]), strict=True):
        # Positions may come from a file instead of the photographs.
        straight_views[index] = replace(view, taken=views[index].taken)
    straight = straighten_links(valid_links(links), views, dict.fromkeys(through, calibration.distortion))
    straight |= {pair: link for pair, link in surveyor.link(straight_views, straight).items() if link.holds}
    # Features of distorted photographs made k1 0.1 to 0.3 % too small.
    terms = min(len(calibration.distortion), 2)
    distortion = measure_remaining_distortion(straight_views, members, valid_links(straight), terms, surveyor.cache)
    remaining = dict.fromkeys(through, distortion)
    straight = straighten_links(valid_links(straight), straight_views, remaining)
    return tuple(straight_views), {**links, **straight}, remaining


def lay_out_all(
    views: Sequence[View],
    parts: Sequence[list[int]],
    links: dict[Candidate, Link],
    link_nearby: Callable[[Layout], dict[Candidate, Link]],
) -> tuple[list[Layout], dict[int, str]]:
    """The layouts of all parts of a flight, and the views that are in none of them, with the reason if it is known.

    What ``link_nearby`` finds by a layout is added to ``links``, and the layout is made again.
    """
    layouts: list[Layout] = []
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
            first, *others = layout.members
            reasons |= {first: layout.fault} | dict.fromkeys(others, f"for the same reason as {views[first].name}")
        elif len(layout.members) > 1:
            layouts.append(layout)
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
    again = lay_out(views, layout.members, valid_links({**links, **nearby}))
    confirmed = {pair: link for pair, link in nearby.items() if link in again.links}
    links |= confirmed
    return again if len(confirmed) == len(nearby) else lay_out(views, layout.members, valid_links(links))


def _link_nearby(
    surveyor: Surveyor, views: Sequence[View], remaining: Mapping[int, Array], layout: Layout
) -> dict[Candidate, Link]:
    """Links of pairs that overlap in a layout, although their features alone did not link them.

    ``remaining`` is the distortion of each view that its features still have.
    """
    transforms = layout.transforms
    known = {(link.left, link.right): link for link in layout.links}
    # Among repeated textures, a search around a false place would find one more link that confirms it.
    disputed = {view for link in layout.contradicting for view in (link.left, link.right)}
    pairs = candidates.predicted(views, transforms, known) if known else set()
    predicted = {
        (left, right): np.linalg.inv(transforms[right]) @ transforms[left]
        for left, right in pairs
        if disputed.isdisjoint((left, right))
    }
    return straighten_links(valid_links(surveyor.link_nearby(views, predicted)), views, remaining)


def _why_alone(view: int, views: Sequence[View], links: Iterable[Link]) -> str:
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
