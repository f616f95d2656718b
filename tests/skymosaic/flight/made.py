"""Views and flights without photographs: the real ones, with what a test says of them and nothing else."""

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from golden_model.config import preset_config
from skymosaic.flight.flight import Flight
from skymosaic.flight.layout.layout import Layout
from skymosaic.flight.linking.links import Link
from skymosaic.flight.linking.view import SHARPNESS_BLOCKS, Settings, View
from skymosaic.imagery.exif import Metadata
from skymosaic.imagery.photographs import Source

CONFIG = preset_config("aerial")
NO_FEATURES = np.zeros(0, CONFIG.front_end.pattern.record.dtype)


def view(name: str = "0.jpg", size: tuple[int, int] = (400, 300), **facts: Any) -> View:
    """A photograph that the front end sees as it is, and that shows nothing."""
    usual: dict[str, Any] = {
        "key": "", "working_size": size, "to_original": np.eye(3), "to_thumbnail": np.eye(3), "features": NO_FEATURES,
        "strongest": NO_FEATURES, "thumbnail": np.zeros((0, 0), np.uint8), "visible": None, "sample": np.zeros(0),
        "value_range": None, "sharpness": np.zeros(SHARPNESS_BLOCKS[::-1], np.float32), "clipped": 0.0,
        "taken": Metadata(), "orientation": 1, "notes": (),
    }  # fmt: skip
    return View(name=name, size=size, **usual | facts)


def views(count: int, size: tuple[int, int] = (400, 300), **facts: Any) -> list[View]:
    """Photographs ``0.jpg`` and so on."""
    return [view(f"{number}.jpg", size, **facts) for number in range(count)]


def flight(views: Sequence[View], links: Iterable[Link] = (), layouts: Iterable[Layout] = (), **changes: Any) -> Flight:
    """Photographs as they are linked and laid out; none is left out."""
    usual: dict[str, Any] = {
        "names": tuple(each.name for each in views),
        "sources": tuple(Source(number, each.name, Path(each.name)) for number, each in enumerate(views)),
        "left_out": {}, "settings": Settings(CONFIG), "seconds": {},
    }  # fmt: skip
    return Flight(views=tuple(views), links=tuple(links), layouts=tuple(layouts), **usual | changes)
