"""Views, flights and mosaics without photographs: the real ones, with what a test says of them and nothing else."""

from collections.abc import Iterable, Sequence
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from golden_model.config import preset_config
from skymosaic.compositing.warp import Canvas
from skymosaic.flight.flight import Flight
from skymosaic.flight.layout.layout import Layout
from skymosaic.flight.linking.links import Link
from skymosaic.flight.linking.view import SHARPNESS_BLOCKS, Settings, View
from skymosaic.flight.mapping.place import MapPlace
from skymosaic.flight.picture.composition import Composition, Placement
from skymosaic.flight.picture.output import Delivery
from skymosaic.imagery.exif import Metadata
from skymosaic.imagery.lens import Lens
from skymosaic.imagery.photographs import Source
from skymosaic.maps.georeference import Georeference

CONFIG = preset_config("aerial")
NAMES = [f"/site/{number}.jpg" for number in range(4)]
# Turned by 30 degrees, 5 cm per pixel.
TURNED = 0.05 * np.array([[np.cos(0.5236), np.sin(0.5236), 8e6], [np.sin(0.5236), -np.cos(0.5236), 1e8], [0, 0, 20]])
ON_MAP = Georeference("EPSG:32615", TURNED, 0.4, (0.3, np.nan, 60.2, 75.4), (2, 3), 0.0123)
PLACE = MapPlace(
    ON_MAP,
    fitted_to=("0.jpg", "1.jpg", "2.jpg", "3.jpg"),
    height_m=81.4,
    recorded_height_m=120.0,
    turned_deg=-12.3,
    checked_m={"CHK-1": 0.3, "CHK-2": 0.5},
)
NO_FEATURES = np.zeros(0, CONFIG.front_end.pattern.record.dtype)


def view(name: str = "0.jpg", size: tuple[int, int] = (400, 300), **facts: Any) -> View:
    """A photograph that the front end sees as it is, and that shows nothing."""
    usual: dict[str, Any] = {
        "key": "", "working_size": size, "to_original": np.eye(3), "to_thumbnail": np.eye(3), "features": NO_FEATURES,
        "strongest": NO_FEATURES, "thumbnail": np.zeros((0, 0), np.uint8), "visible": None, "sample": np.zeros(0),
        "value_range": None, "sharpness": np.zeros(SHARPNESS_BLOCKS[::-1], np.float32),
        "clipped": np.zeros((60, 80), np.uint8), "taken": Metadata(), "orientation": 1, "notes": (),
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


def flight_along(
    views: Sequence[View], steps: Sequence[tuple[float, float]], positions: str = "", **changes: Any
) -> tuple[Flight, Layout]:
    """Photographs that lie ``steps`` (x, y) px from the first one's corner, and their layout with ``changes``."""
    shifts = {view: np.array([[1.0, 0, x], [0, 1, y], [0, 0, 1]]) for view, (x, y) in enumerate(steps)}
    layout = Layout(tuple(shifts), 0, shifts, **changes)
    return flight(views, (), [layout], positions=positions), layout


def tie(left: int, right: int, count: int, checks: int = 0, off_px: float = 0.0) -> Link:
    """A link of a photograph and its copy, with matches kept aside that are off."""
    points = np.random.default_rng(left).uniform(0, 300, (count, 2))
    aside = np.random.default_rng(right).uniform(0, 300, (checks, 2))
    moved = np.add(aside, (off_px, 0))
    return Link(left, right, points, points, count, count + count // 4, left_checks=aside, right_checks=moved)


def delivered(**changes: Any) -> Delivery:
    """A mosaic of three of four photographs; the reference is not the first. ``changes`` are of whichever has them."""
    layout = Layout(
        members=(0, 1, 3),
        reference=1,
        transforms={member: np.eye(3) for member in (0, 1, 3)},
        links=(tie(0, 1, 120), tie(1, 3, 40)),
        contradicting=(tie(0, 3, 9),),
        errors_px=(np.full(120, 0.5), np.array([2.0] * 39 + [9.0])),
        model="affine",
        reason="as good as a homography",
    )
    views = [view(name, (800, 600), working_size=(400, 300), to_original=np.diag([2.0, 2, 1])) for name in NAMES]
    links = (*layout.links, *layout.contradicting, tie(0, 2, 1))
    flown = flight(views, links, (layout,), left_out={2: "/site/2.jpg: blurred"})
    onto_canvas = {0: np.eye(3), 1: np.diag([3.0, 3, 1]), 3: np.eye(3)}
    placements = tuple(Placement(flown.sources[m], (800, 600), onto_canvas[m]) for m in layout.members)
    composition = Composition(placements, Canvas(0, 0, 800, 500), True, "multiband", Lens())
    shown, covered = np.zeros((50, 80, 3), np.uint8), np.full((50, 80), 255, np.uint8)
    parts: dict[str, Any] = {
        "flight": flown,
        "composition": composition,
        "delivery": Delivery(Path("out/m.tif"), flown, layout, composition, "", shown, covered, 1.26),
    }
    for name, value in changes.items():
        owner = next(part for part, whole in parts.items() if name in {each.name for each in fields(whole)})
        parts[owner] = replace(parts[owner], **{name: value})
    delivery: Delivery = replace(parts.pop("delivery"), **parts)
    return delivery
