"""Fits a layout to ties and to known places at once: where cameras were, and surveyed points.

Ties leave a long flight free to bend, because small errors of many links add up. Positions are far less exact than
ties, but their errors do not add up.
"""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from golden_model.arrays import Array, Points
from skymosaic.flight.layout.adjustment import Anchors
from skymosaic.flight.layout.layout import Layout, linked_group
from skymosaic.flight.linking.view import View
from skymosaic.geometry.homography import apply

MAX_OUTSIDE = 2.0
"""Points farther from the middle of their view, in half diagonals, are left out, as below a camera that looks ahead."""


@dataclass(frozen=True, eq=False)
class Observation:
    """A point of a view whose place is known.

    Attributes
    ----------
    view : int
    point : ndarray of float64, shape (2,)
        Working px of the view.
    place : ndarray of float64, shape (2,)
        Ground px of the layout.
    sigma_px : float
        Standard deviation of the place, ground px.
    """

    view: int
    point: Points
    place: Points
    sigma_px: float


def anchor(layout: Layout, views: Sequence[View], observations: Sequence[Observation]) -> Layout:
    """Adjust a layout once more, to its ties and to observations; which links contradict it stays as it is."""
    group = linked_group(views, layout.members, layout.links, reference=layout.reference)
    row = {member: index for index, member in enumerate(group.members)}
    normalised = group.normalisations[group.reference]
    points = np.array([apply(group.normalisations[row[each.view]], each.point) for each in observations])
    near = np.linalg.norm(points, axis=1) <= MAX_OUTSIDE
    anchors = Anchors(
        views=np.array([row[each.view] for each in observations])[near],
        points=points[near],
        places=apply(normalised, np.array([each.place for each in observations]))[near],
        sigma=np.array([each.sigma_px for each in observations])[near] * normalised[0, 0],
    )
    network = group.network(slice(None))
    start = np.stack([_to_normalised(layout.transforms[m], normalised, group.normalisations[row[m]]) for m in row])
    adjusted = network.adjust(start, layout.model, anchors=anchors)
    return dataclasses.replace(
        layout, transforms=group.to_ground(adjusted), errors_px=tuple(network.errors_px(adjusted))
    )


def _to_normalised(transform: Array, ground: Array, view: Array) -> Array:
    matrix = ground @ transform @ np.linalg.inv(view)
    return np.asarray(matrix / matrix[2, 2])
