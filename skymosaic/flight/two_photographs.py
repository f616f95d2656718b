"""Two photographs are a small flight: one link, and a layout in the frame of the right photograph."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from skymosaic.common.stopwatch import Stopwatch
from skymosaic.compositing.mesh import Frame, Judged, Mesh, Ties, fit_meshes
from skymosaic.features.given_matches import GivenMatches
from skymosaic.features.positions import match_points
from skymosaic.flight.flight import Flight
from skymosaic.flight.layout.layout import Layout
from skymosaic.flight.linking.links import Link, tie_views
from skymosaic.flight.linking.view import Settings, make_view
from skymosaic.geometry.homography import transfer_error
from skymosaic.imagery.lens import Lens
from skymosaic.imagery.photographs import Source, decoded_photographs
from skymosaic.registration.options import RegistrationOptions
from skymosaic.registration.pair import Pair
from skymosaic.registration.register import register_photographs
from skymosaic.running.workers import Progress


def register_two(
    sources: Sequence[Source],
    options: RegistrationOptions,
    lens: Lens,
    *,
    given: GivenMatches | None = None,
    bend: bool,
    memory_bytes: int,
    progress: Progress,
) -> Flight:
    """Register two photographs, left and right, and keep them decoded for the picture, if ``memory_bytes`` allow it.

    Where the left one is to ``bend`` over relief, it does if held-out matches gain by it; matches that are ``given``
    take the place of features.
    """
    progress("registering", 0, 0)
    clock = Stopwatch()
    left, right = (source.read_photograph(lens) for source in sources)
    for photograph in (left, right):
        lens.check(photograph.size, photograph.name)
    clock.lap("reading")
    pair = register_photographs(
        (left, right),
        options,
        lens=lens,
        given=given,
        seconds=clock.seconds,
        progress=lambda line: progress(line, 0, 0),
    )
    for source, photograph in zip(sources, (left, right), strict=True):
        decoded_photographs(memory_bytes).keep(source, lens, (photograph.pixels, photograph.visible))
    flight = flight_of_pair(pair, sources, lens)
    if not bend:
        return flight
    return replace(flight, layouts=tuple(layout.with_meshes(*fit_mesh(pair)) for layout in flight.layouts))


def fit_mesh(pair: Pair) -> tuple[dict[int, Mesh], Judged]:
    """As `fit_meshes`, for the left photograph of a pair, 0."""
    assert pair.working_homography is not None
    sizes = [(image.shape[1], image.shape[0]) for image in pair.working]
    frames = {0: Frame(sizes[0], pair.working_homography), 1: Frame(sizes[1], np.eye(3))}
    ties = [Ties(0, 1, *match_points(pair.kept))]
    return fit_meshes(frames, ties, (0,))


def flight_of_pair(pair: Pair, sources: Sequence[Source], lens: Lens) -> Flight:
    """Turn a registered pair into a flight; without a layout if the pair was not accepted.

    The distortion of the lens is already taken out of the pair's photographs.
    """
    settings = Settings(pair.config, pair.backend, max(image.shape[1] for image in pair.working), lens)
    views = tuple(
        make_view(source, photograph, settings, working=working, to_original=to_original, features=features)
        for source, photograph, working, to_original, features in zip(
            sources, (pair.left, pair.right), pair.working, pair.to_original, pair.features, strict=True
        )
    )
    link = _link(pair)
    return Flight(
        names=tuple(source.name for source in sources),
        sources=tuple(sources),
        views=views,
        links=(link,),
        layouts=(_layout(pair, link),) if pair.accepted else (),
        left_out={} if pair.accepted else {source.index: f"{source.name}: {pair.reason}" for source in sources},
        settings=settings,
        seconds=pair.seconds,
        pair=pair,
    )


def _link(pair: Pair) -> Link:
    left_points, right_points = match_points(pair.kept)
    if pair.working_homography is None:
        return Link(0, 1, left_points[:0], right_points[:0], len(pair.inliers), near=0)
    return tie_views((0, 1), left_points, right_points, pair.working_homography, len(pair.inliers))


def _layout(pair: Pair, link: Link) -> Layout:
    """The right photograph defines the ground: with two photographs nothing else tells what is level."""
    assert pair.working_homography is not None
    homography = pair.working_homography
    errors_px = transfer_error(homography, link.left_points, link.right_points)
    return Layout(
        members=(0, 1),
        reference=1,
        transforms={0: homography, 1: np.eye(3)},
        links=(link,),
        errors_px=(errors_px,),
        model="homography",
        reason="two photographs, in the frame of the right one",
    )
