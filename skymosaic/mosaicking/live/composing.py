"""Composes a live mosaic anew from its frames, as a flight is composed, where these still exist.

Painted pixels were moved each time the layout changed, which costs detail, and brightness was matched frame by frame.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from skymosaic.flight.flight import Flight
from skymosaic.flight.layout.layout import Layout
from skymosaic.flight.linking.view import Settings, View, make_view
from skymosaic.geometry.homography import resize_matrix
from skymosaic.imagery.images import reduce_for_front_end
from skymosaic.imagery.photographs import Source
from skymosaic.mosaicking.live.submap import Frame
from skymosaic.running.workers import Workers


def flight_of_frames(
    frames: Sequence[Frame], sources: Mapping[str, Source], settings: Settings, scale: float, workers: Workers
) -> Flight | None:
    """Turn the frames of a live mosaic into a flight with one layout; None if one of them no longer exists.

    Parameters
    ----------
    frames : sequence of Frame
        Those of one submap, the first one first.
    sources : mapping of str to Source
        What can be read, by the names of the frames.
    settings : Settings
    scale : float
        Of the live mosaic.
    workers : Workers

    Raises
    ------
    InputError
        For a frame that can no longer be read.
    """
    if not frames or any(frame.name not in sources for frame in frames):
        return None
    used = tuple(sources[frame.name] for frame in frames)
    calls = [(source, frame, settings) for source, frame in zip(used, frames, strict=True)]
    views = tuple(workers.run("frames", _view, calls))
    # The ground is the first frame without its tilt, in pixels of the mosaic; a layout has working pixels.
    to_ground = np.linalg.inv(resize_matrix(scale) @ frames[0].to_original)
    layout = Layout(
        members=tuple(range(len(frames))),
        reference=0,
        transforms={index: np.asarray(to_ground @ frame.transform) for index, frame in enumerate(frames)},
        model="homography",
        reason="as the frames came",
    )
    names = tuple(frame.name for frame in frames)
    return Flight(names, used, views, links=(), layouts=(layout,), left_out={}, settings=settings, seconds={})


def _view(source: Source, frame: Frame, settings: Settings) -> View:
    photograph = source.read_photograph(settings.lens)
    working, to_original = reduce_for_front_end(photograph.pixels, settings.working_width_px, source.name)
    return make_view(source, photograph, settings, working=working, to_original=to_original, features=frame.features)
