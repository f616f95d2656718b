"""What is kept of a photograph of a flight once its pixels are dropped: features, a thumbnail, where and how sharp."""

from __future__ import annotations

import dataclasses
import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from golden_model.arrays import Array, Pixels, Records
from golden_model.config import Config
from golden_model.pixel.gray import to_gray
from sim.backend import load_backend
from skymosaic.features.positions import feature_points
from skymosaic.flight.cache import Arrays, key_of
from skymosaic.imagery.exif import Position, position
from skymosaic.imagery.images import reduced
from skymosaic.imagery.lens import Lens
from skymosaic.imagery.photographs import Source
from skymosaic.registration import WORKING_WIDTH_PX, extract_within_capacity

THUMBNAIL_WIDTH_PX = 320
MASK_MARGIN_PX = 40
"""Features keep this distance from what is masked, in working pixels: beyond it no descriptor sees the mask."""

_ARRAYS = ("to_original", "to_thumbnail", "features", "thumbnail")
_FACTS = ("size", "working_size", "sharpness", "clipped", "place", "notes")


@dataclass(frozen=True, eq=False)
class View:
    """A photograph as the layout of a flight knows it.

    Attributes
    ----------
    name : str
        Of its source.
    key : str
        Changes with the photograph's content and all that the view was computed with.
    size, working_size : (int, int)
        Width and height of the original and of the image the front end saw, px.
    to_original, to_thumbnail : ndarray of float64, shape (3, 3)
        From working pixels to those of the original and of the thumbnail.
    features : structured ndarray
        Feature records of the working image.
    thumbnail : ndarray of uint8, shape (h, w) or (h, w, 3)
    sharpness : float
        Variance of the Laplacian of the gray working image; falls with blur, and depends on what is shown.
    clipped : float
        Share of thumbnail pixels that are black or white.
    place : Position or None
        GPS.
    notes : tuple of str
        What was done to the file's pixels.
    """

    name: str
    key: str
    size: tuple[int, int]
    working_size: tuple[int, int]
    to_original: Array
    to_thumbnail: Array
    features: Records
    thumbnail: Pixels
    sharpness: float
    clipped: float
    place: Position | None
    notes: tuple[str, ...]

    def packed(self) -> Arrays:
        """The view as arrays for a file; `unpacked` reads them. The name is left out: files are renamed."""
        arrays = {name: getattr(self, name) for name in _ARRAYS}
        facts = {name: getattr(self, name) for name in _FACTS}
        facts["place"] = None if self.place is None else dataclasses.astuple(self.place)
        return arrays | {"facts": np.array(json.dumps(facts))}

    @property
    def points(self) -> Array:
        """Positions of the features, (N, 2), working px."""
        return feature_points(self.features)


def unpacked(arrays: Arrays, name: str, key: str) -> View:
    """The view that `View.packed` put into arrays."""
    facts = json.loads(str(arrays["facts"]))
    place = None if facts["place"] is None else Position(*facts["place"])
    size, working_size, notes = (tuple(facts[key]) for key in ("size", "working_size", "notes"))
    facts |= {"size": size, "working_size": working_size, "notes": notes, "place": place}
    values: dict[str, Any] = {key: arrays[key] for key in _ARRAYS} | facts
    return View(name=name, key=key, **values)


@dataclass(frozen=True, eq=False)
class Settings:
    """How the photographs of a flight are looked at.

    Attributes
    ----------
    config : Config
        Front end and matcher.
    backend : str
        Who computes the features.
    working_width_px : int
        Wider photographs are reduced by area for the layout.
    lens : Lens
        Distortion and mask, the same for all photographs.
    """

    config: Config
    backend: str = "golden"
    working_width_px: int = WORKING_WIDTH_PX
    lens: Lens = field(default_factory=Lens)

    def key(self, source: Source) -> str:
        """Of the view that `describe` would make."""
        how = self.lens.key, self.config.front_end, self.backend, self.working_width_px
        return key_of("view", source.digest, *how)

    def second_look(self) -> Settings | None:
        """The same with twice the features and descriptor, by the golden model; None where the preset has no more."""
        front_end = self.config.front_end
        if not front_end.selection or front_end.descriptor != "ilbp-128":
            return None
        more = dataclasses.replace(front_end, max_features=4096, descriptor="ilbp-256", cell_px=None, per_cell=None)
        return dataclasses.replace(self, backend="golden", config=dataclasses.replace(self.config, front_end=more))


def describe(source: Source, settings: Settings) -> View:
    """Decode a photograph and keep what the layout needs.

    Raises
    ------
    InputError
        For a photograph that cannot be used.
    """
    photograph = source.photograph(settings.lens)
    working, to_original = reduced(photograph.pixels, settings.working_width_px)
    thumbnail, from_thumbnail = reduced(working, THUMBNAIL_WIDTH_PX)
    results, _ = extract_within_capacity(load_backend(settings.backend), [working], settings.config)
    working_size = working.shape[1], working.shape[0]
    gray = to_gray(thumbnail)
    return View(
        name=source.name,
        key=settings.key(source),
        size=photograph.size,
        working_size=working_size,
        to_original=to_original,
        to_thumbnail=np.linalg.inv(from_thumbnail).astype(np.float64),
        features=_on_the_ground(results[0].features, settings.lens.visible(working_size)),
        thumbnail=thumbnail,
        sharpness=float(cv2.Laplacian(to_gray(working), cv2.CV_32F).var()),
        clipped=float(np.mean((gray <= 2) | (gray >= 253))),
        place=position(source.content) if isinstance(source.content, Path) else None,
        notes=photograph.notes,
    )


def _on_the_ground(features: Records, visible: Pixels | None) -> Records:
    if visible is None:
        return features
    kernel = np.ones((2 * MASK_MARGIN_PX + 1, 2 * MASK_MARGIN_PX + 1), np.uint8)
    inside = cv2.erode(visible, kernel, borderType=cv2.BORDER_CONSTANT, borderValue=255)
    x, y = np.rint(feature_points(features)).astype(np.intp).T
    kept: Records = features[inside[y, x] == 255]
    return kept
