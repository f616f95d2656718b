"""A registered pair as a flight of two photographs: one link, and a layout in the frame of the right photograph."""

from collections.abc import Sequence

import numpy as np

from skymosaic.features.positions import match_points
from skymosaic.flight.layout.layout import Layout
from skymosaic.flight.linking.links import Link, tie_views
from skymosaic.flight.linking.view import Settings, make_view
from skymosaic.flight.survey import Flight
from skymosaic.geometry.homography import transfer_error
from skymosaic.imagery.lens import Lens
from skymosaic.imagery.photographs import Source
from skymosaic.registration.pair import Pair


def flight_of_pair(pair: Pair, sources: Sequence[Source], lens: Lens) -> Flight:
    """Turn a registered pair into a flight; without a layout if the pair was not accepted.

    Parameters
    ----------
    pair : Pair
    sources : sequence of Source
        The left and the right photograph.
    lens : Lens
        Distortion and mask of the photographs; the distortion is already taken out of the pair's.
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
