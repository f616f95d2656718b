"""Composes a live mosaic from its frames, as a flight is composed: the frames and links of a submap are a flight."""

from collections.abc import Sequence
from dataclasses import replace

from skymosaic.common.errors import InputError, RegistrationError
from skymosaic.flight.flight import Flight
from skymosaic.flight.layout.linked_group import groups
from skymosaic.flight.linking.links import Link, valid_links
from skymosaic.flight.linking.view import Settings, View, describe
from skymosaic.flight.mapping.anchoring import fit_layout
from skymosaic.flight.survey import lay_out_all
from skymosaic.imagery.photographs import Source
from skymosaic.mosaicking.live.kept_frames import KeptFrames
from skymosaic.mosaicking.live.submap import Frame
from skymosaic.running.workers import Workers


def flight_of_frames(
    frames: Sequence[Frame], links: Sequence[Link], kept: KeptFrames, settings: Settings, workers: Workers
) -> Flight:
    """Turn the frames of a submap into a flight with their links, laid out as photographs are.

    The links are by the numbers of the frames. Frames that can no longer be read are left out, with the reason.

    Raises
    ------
    RegistrationError
        If no frame can be read.
    """
    calls: list[tuple[Source, Frame, Settings]] = []
    left_out: dict[int, str] = {}
    for frame in frames:
        try:
            calls.append((kept.read(frame.number), frame, settings))
        except InputError as error:
            left_out[frame.number] = str(error)
    sources, views, row = list[Source](), list[View](), dict[int, int]()
    for (source, frame, _), view in zip(calls, workers.run("frames", _view, calls), strict=True):
        if isinstance(view, str):
            left_out[frame.number] = view
            continue
        row[frame.number] = len(views)
        sources.append(source)
        views.append(replace(view, taken=frame.taken))
    if not views:
        raise RegistrationError(f"none of the {len(frames)} frames can be read again: {next(iter(left_out.values()))}")
    inside = [(row[link.left], row[link.right], link) for link in links if link.left in row and link.right in row]
    between = {(left, right): replace(link, left=left, right=right) for left, right, link in inside}
    layouts, alone = lay_out_all(views, groups(len(views), valid_links(between)), between, lambda _layout: {})
    linked = {index for pair in between for index in pair}
    for index, reason in alone.items():
        if index in linked:
            unknown = "its links contradict each other or the layout, so its place is unknown"
        else:
            unknown = "what linked it was left out" if links else "nothing links it to the others"
        left_out[sources[index].index] = f"{views[index].name}: {reason or unknown}"
    flight = Flight(
        names=tuple(frame.name for frame in frames),
        sources=tuple(sources),
        views=tuple(views),
        links=tuple(between.values()),
        layouts=tuple(layouts),
        left_out=left_out,
        settings=settings,
        seconds={},
    )
    return replace(flight, layouts=tuple(fit_layout(flight, layout) for layout in layouts))


def _view(source: Source, frame: Frame, settings: Settings) -> View | str:
    """The view of a frame, or why it cannot be read."""
    try:
        return describe(source, settings, frame.features)
    except InputError as error:
        return str(error)
