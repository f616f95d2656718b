"""A flight with what its place on the map needs, and its layout, without photographs."""

from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np

from skymosaic.imagery.lens import Lens
from skymosaic.imagery.photographs import short_names


def lay_out(views: Sequence[Any], steps: Sequence[tuple[float, float]]) -> tuple[Any, Any]:
    """The flight and the layout of views that lie ``steps`` (x, y) px from the first one's corner."""
    shifts = {view: np.array([[1.0, 0, x], [0, 1, y], [0, 0, 1]]) for view, (x, y) in enumerate(steps)}
    layout = SimpleNamespace(members=tuple(shifts), to_reference=lambda _views: shifts, meshes={})
    names = [view.name for view in views]
    facts = {"settings": SimpleNamespace(lens=Lens()), "short_names": dict(zip(names, short_names(names), strict=True))}
    return SimpleNamespace(views=views, lens=Lens(), layouts=(layout,), positions="", onto=None, **facts), layout
