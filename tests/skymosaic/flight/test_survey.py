from typing import Any

import numpy as np
import pytest

from sim.scene import Flight
from skymosaic.flight.linking import surveyor
from skymosaic.flight.linking.links import Link, link_views
from skymosaic.mosaicking.api import open_plan
from skymosaic.mosaicking.options import MosaicOptions

HARD = (0, 2)
"""Photographs that overlap, but match only once a layout says where."""


def test_a_layout_links_what_features_alone_do_not(flight: Flight, monkeypatch: pytest.MonkeyPatch) -> None:
    tried: list[tuple[tuple[int, int], bool]] = []

    def link(pair: tuple[int, int], left: Any, right: Any, *, predicted: Any = None, **settings: Any) -> Link:
        tried.append((pair, predicted is not None))
        if pair == HARD and predicted is None:
            return Link(*pair, np.zeros((0, 2)), np.zeros((0, 2)), inliers=4, near=0)
        return link_views(pair, left, right, predicted=predicted, **settings)

    monkeypatch.setattr(surveyor, "link_views", link)
    with open_plan(list(flight.images), MosaicOptions()) as plan:
        (layout,) = plan.layouts
    assert (HARD, False) in tried
    assert (HARD, True) in tried
    assert HARD in {(link.left, link.right) for link in layout.links}
    assert layout.members == tuple(range(len(flight.images)))
