"""What a flight keeps of each photograph: features, a thumbnail, GPS and sharpness."""

from __future__ import annotations

import dataclasses
import json
from dataclasses import dataclass, field
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from golden_model.arrays import Array, Float32, Pixels, Records
from golden_model.cache import Arrays
from golden_model.code_digest import digest_code
from golden_model.config import Config
from golden_model.pixel.gray import to_gray
from skymosaic.common.errors import InputError
from skymosaic.features.backends import BACKENDS, load_backend
from skymosaic.features.contrast import even_contrast
from skymosaic.features.positions import are_on_ground, feature_points, raw_positions
from skymosaic.flight.linking.resemblance import compact
from skymosaic.geometry.ground import Sight
from skymosaic.imagery.depth import ValueRange, measure_clipped
from skymosaic.imagery.exif import Metadata, Position
from skymosaic.imagery.images import Photograph, load, reduce_for_front_end, reduce_to_width
from skymosaic.imagery.lens import Lens
from skymosaic.imagery.photographs import Source
from skymosaic.registration.extraction import extract_within_capacity
from skymosaic.registration.options import WORKING_WIDTH_PX
from skymosaic.running.cache import key_of

THUMBNAIL_WIDTH_PX = 320
SHARPNESS_BLOCKS = (16, 12)
"""Blocks along the width and the height of a photograph, of which each is as sharp as it is."""
HEAVY = ("features", "thumbnail")
"""Attributes of a view that stay with the worker that computed them, as Dask's futures."""


@dataclass(frozen=True, eq=False)
class View:
    """A photograph as the layout of a flight knows it."""

    name: str
    """Name of its source."""
    key: str
    """Cache key, which changes with the photograph's content and with everything that computed the view."""
    size: tuple[int, int]
    working_size: tuple[int, int]
    """Width and height of the original and of the image the front end saw, px."""
    to_original: Array
    to_thumbnail: Array
    """(3, 3): from working pixels to those of the original and of the thumbnail."""
    features: Records
    """Feature records of the working image; none once the flight is linked."""
    strongest: Records
    """The strongest of them, see `skymosaic.flight.linking.resemblance`."""
    thumbnail: Pixels
    visible: Pixels | None
    """(h, w): 0 where the thumbnail's pixels have no data or are transparent; None where none are."""
    sample: NDArray[np.generic]
    """Values of a photograph of more than 8 bits, at evenly spaced places; else empty."""
    value_range: ValueRange | None
    """The range that the thumbnail shows; None for a photograph of 8 bits."""
    sharpness: Float32
    """(12, 16): in blocks of the gray working image, the logarithm of the mean square of its Laplacian over its
    variance; falls with blur, hardly depends on exposure, and depends on what is shown."""
    clipped: Pixels
    """`skymosaic.imagery.depth.measure_clipped` of the photograph."""
    taken: Metadata
    """How it was taken, from EXIF and XMP."""
    orientation: int
    """The EXIF orientation by which it was turned upright."""
    notes: tuple[str, ...]
    """What was done to the file's pixels."""

    def pack(self) -> Arrays:
        """Turn the view into arrays for a file; without the name, because photographs are renamed."""
        values = {name: value for name, value in vars(self).items() if name not in ("name", "key")}
        arrays = {name: value for name, value in values.items() if isinstance(value, np.ndarray)}
        facts = {name: value for name, value in values.items() if name not in arrays}
        return arrays | {"facts": np.array(json.dumps(facts, default=dataclasses.asdict))}

    @classmethod
    def unpack(cls, arrays: Arrays, name: str, key: str) -> View:
        """Read the view that `pack` turned into arrays."""
        values: dict[str, Any] = dict(arrays)
        values |= json.loads(str(values.pop("facts")))
        values |= {each: tuple(values[each]) for each in ("size", "working_size", "notes")}
        position, known_range = values["taken"].pop("position"), values["value_range"]
        values["taken"] = Metadata(None if position is None else Position(**position), **values["taken"])
        values["value_range"] = None if known_range is None else ValueRange(**known_range)
        return cls(name=name, key=key, **values)

    @property
    def gps(self) -> Position | None:
        """Where the camera was."""
        return self.taken.position

    @property
    def sight(self) -> Sight:
        """The ground that it shows, to tell whether this agrees."""
        return Sight(self.thumbnail, self.visible, np.linalg.inv(self.to_thumbnail).astype(np.float64))

    @property
    def light(self) -> View:
        """The same view with neither features nor thumbnail."""
        return dataclasses.replace(self, features=self.strongest[:0], thumbnail=np.zeros((0, 0), np.uint8))


@dataclass(frozen=True, eq=False)
class Settings:
    """How features are computed, the same for all photographs of a flight."""

    config: Config
    """Front end and matcher."""
    backend: str = "golden"
    """Name of the backend that computes the features."""
    working_width_px: int = WORKING_WIDTH_PX
    """Wider photographs are reduced by area for the layout."""
    lens: Lens = field(default_factory=Lens)
    """Distortion and mask, the same for all photographs."""

    def key(self, source: Source) -> str:
        """Cache key of the view that `describe` makes of ``source``."""
        how = self.lens.key, self.config.front_end, self.backend, self.working_width_px
        # It is imported by its name. An object as a backend has none; it serves pairs, of which nothing is kept.
        module = BACKENDS.get(self.backend.partition(":")[0])
        code = module and digest_code(module)
        bands = [band.digest for band in source.bands.values()]
        return key_of(describe, source.digest, *bands, source.taken, source.keep_damaged, *how, code)

    def with_more_features(self) -> Settings | None:
        """Twice the features and descriptor bits, by the golden model; None if the preset cannot have more."""
        front_end = self.config.front_end
        if not front_end.selection or front_end.descriptor != "ilbp-128":
            return None
        more = dataclasses.replace(front_end, max_features=4096, descriptor="ilbp-256", cell_px=None, per_cell=None)
        return dataclasses.replace(self, backend="golden", config=dataclasses.replace(self.config, front_end=more))


def describe(source: Source, settings: Settings, features: Records | None = None) -> View:
    """Decode a photograph, compute its features, unless they are given, and keep what the layout needs.

    Raises
    ------
    InputError
        For a photograph that cannot be used, or a set of which a band cannot be.
    """
    photograph = source.read_photograph(settings.lens)
    for band in source.bands.values():
        if band.content != source.content:
            # Read here, a damaged band leaves out its capture; later, it would end the run.
            load(band.content, band.name, keep_damaged=band.keep_damaged)
    working, to_original = reduce_for_front_end(photograph.pixels, settings.working_width_px, source.name)
    if features is None:
        features = _extract_from_ground(working, settings, photograph)
    return make_view(source, photograph, settings, working=working, to_original=to_original, features=features)


def describe_thumbnail(
    thumbnail: Pixels, view: View, settings: Settings, even: bool = False, pattern: Float32 | None = None
) -> View:
    """Take the thumbnail of a view for its working image; without features if the front end cannot take it.

    With ``even``, its contrast is made the same everywhere before, without the ``pattern``.
    """
    if even:
        thumbnail = even_contrast(thumbnail, pattern)
    try:
        features = _extract_from_ground(thumbnail, settings, view)
    except InputError:
        features = np.zeros(0, settings.config.front_end.pattern.record.dtype)
    from_thumbnail = np.linalg.inv(view.to_thumbnail).astype(np.float64)
    return dataclasses.replace(
        view,
        key=key_of(describe_thumbnail, view.key, settings.config.front_end, even, pattern is None or pattern.tobytes()),
        working_size=(thumbnail.shape[1], thumbnail.shape[0]),
        to_original=view.to_original @ from_thumbnail,
        to_thumbnail=np.eye(3),
        features=features,
        strongest=compact(features),
        thumbnail=thumbnail,
    )


def straighten(view: View, lens: Lens) -> View:
    """Show a view as a camera without the lens's distortion would have: features are moved, but not described again.

    Those that leave the picture are dropped.
    """
    upright = lens.turned(view.orientation)
    points = upright.straighten_points(feature_points(view.features), view.working_size)
    inside = ((points >= 0) & (points < view.working_size)).all(axis=1)
    features = view.features[inside]
    features["x"], features["y"] = raw_positions(points[inside]).T
    return dataclasses.replace(
        view,
        key=key_of(straighten, view.key, lens.key),
        features=features,
        thumbnail=np.asarray(upright.straighten(view.thumbnail), dtype=np.uint8),
        visible=None if view.visible is None else upright.straighten_mask(view.visible),
        clipped=np.asarray(upright.straighten(view.clipped), dtype=np.uint8),
    )


def _extract_from_ground(working: Pixels, settings: Settings, shown: Photograph | View) -> Records:
    """Compute the features of an image, without those on what the lens or the photograph's own mask hides."""
    backend = load_backend(settings.backend)
    try:
        results, _ = extract_within_capacity(backend, [working], settings.config)
    except ValueError as error:  # for instance, more cells than features
        raise InputError(f"{shown.name}: the front end cannot take it: {error}") from None
    features: Records = results[0].features
    lens = settings.lens.turned(shown.orientation)
    visible = lens.visible_mask((working.shape[1], working.shape[0]), shown.visible)
    return features[are_on_ground(feature_points(features), visible)]


def make_view(
    source: Source,
    photograph: Photograph,
    settings: Settings,
    *,
    working: Pixels,
    to_original: Array,
    features: Records,
    taken: Metadata | None = None,
) -> View:
    """Keep what the layout needs of a photograph whose features are known.

    The lens's distortion is taken out of the photograph and of ``working``, the image that the front end saw. How it
    was ``taken`` is read from a file unless it is given.
    """
    thumbnail, from_thumbnail = reduce_to_width(working, THUMBNAIL_WIDTH_PX)
    return View(
        name=source.name,
        key=settings.key(source),
        size=photograph.size,
        working_size=(working.shape[1], working.shape[0]),
        to_original=to_original,
        to_thumbnail=np.linalg.inv(from_thumbnail).astype(np.float64),
        features=features,
        strongest=compact(features),
        thumbnail=thumbnail,
        visible=Lens().visible_mask((thumbnail.shape[1], thumbnail.shape[0]), photograph.visible),
        sample=photograph.sample,
        value_range=photograph.value_range,
        sharpness=_measure_sharpness(to_gray(working).astype(np.float32)),
        clipped=measure_clipped(photograph.pixels),
        taken=taken or source.read_metadata(),
        orientation=photograph.orientation,
        notes=photograph.notes,
    )


def _measure_sharpness(gray: Float32) -> Float32:
    """Measure the `View.sharpness` of a working image."""
    planes = gray, gray * gray, np.square(cv2.Laplacian(gray, cv2.CV_32F))
    mean, square, fine = (cv2.resize(plane, SHARPNESS_BLOCKS, interpolation=cv2.INTER_AREA) for plane in planes)
    # What rounding adds to each counts where nothing is shown.
    return np.asarray(np.log(fine + 0.5) - np.log(np.maximum(square - mean * mean, 1)), dtype=np.float32)
