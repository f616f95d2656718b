"""Finds blurred photographs by comparison with others of the same ground, and badly exposed ones."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from golden_model.arrays import Array
from skymosaic.flight.linking.links import Link
from skymosaic.flight.linking.view import View

BLURRED = 0.25
"""A photograph is blurred if its sharpness is below this share of its neighbours': a blur of about 0.8 working px."""
CLIPPED = 0.2
"""It is badly exposed if more than this share of it is black or white."""


def sharpness_ratios(views: Sequence[View], links: Sequence[Link]) -> Array:
    """Sharpness of each view against the median of those it is linked with, or of all where it has no link, (V,).

    Sharpness depends more on the ground than on the lens, so only views of the same ground are compared.
    """
    neighbours: list[list[float]] = [[] for _ in views]
    for link in links:
        if link.holds:
            neighbours[link.left].append(views[link.right].sharpness)
            neighbours[link.right].append(views[link.left].sharpness)
    overall = float(np.median([view.sharpness for view in views]))
    expected = [float(np.median(around)) if around else overall for around in neighbours]
    return np.array([view.sharpness / max(value, 1e-9) for view, value in zip(views, expected, strict=True)])
