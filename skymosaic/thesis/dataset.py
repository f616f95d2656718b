"""The dataset of the experiments: the user's pairs, or a rendered flight, at the image size of the thesis."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path

import numpy as np

from golden_model.arrays import Matrix, Pixels
from golden_model.pixel.gray import to_gray
from sim.scene import Flight, make_lawnmower
from skymosaic.common.errors import InputError
from skymosaic.evaluation.known_pairs import KnownPair, read_pairs
from skymosaic.evaluation.metrics import grid_error
from skymosaic.imagery.images import load, reduce_to_width

WORKING_WIDTH_PX = 640
"""Wider photographs are reduced to this width (thesis, section IV.6.2.1)."""
RENDERED_IMAGES = 12
RENDERED_SIZE = (WORKING_WIDTH_PX, 480)
RENDERED_SEED = 4


@dataclass(frozen=True, eq=False)
class DatasetPair:
    """A pair of images with the known homography between them.

    Raises
    ------
    skymosaic.common.errors.InputError
        If the images do not overlap under the true homography.
    """

    name: str
    group: str
    left: Pixels
    right: Pixels
    truth: Matrix
    """(3, 3): maps left to right."""

    def __post_init__(self) -> None:
        try:
            grid_error(self.truth, self.truth, *self.sizes)
        except ValueError as error:
            raise InputError(f"{self.name}: {error}; its homography must map left pixels to right pixels") from None

    @cached_property
    def grays(self) -> tuple[Pixels, Pixels]:
        """Both images in gray."""
        return to_gray(self.left), to_gray(self.right)

    @property
    def sizes(self) -> tuple[tuple[int, int], tuple[int, int]]:
        """Width and height of both images, px."""
        left, right = ((image.shape[1], image.shape[0]) for image in (self.left, self.right))
        return left, right


Source = Callable[[], DatasetPair]
"""Loads or renders a pair when it is called."""


def list_sources(data: Path | None) -> Sequence[Source]:
    """List the pairs of ``data``/pairs.csv, or neighbouring pictures of a rendered survey flight.

    Raises
    ------
    skymosaic.common.errors.InputError
        For a list that is missing or malformed.
    """
    if data is not None:
        return [partial(_load_pair, pair) for pair in read_pairs(data)]
    flight = make_lawnmower(RENDERED_SEED, RENDERED_IMAGES, RENDERED_SIZE)
    return [partial(_render_pair, flight, index) for index in range(RENDERED_IMAGES - 1)]


def _load_pair(pair: KnownPair) -> DatasetPair:
    left, right = (reduce_to_width(load(path).pixels, WORKING_WIDTH_PX) for path in (pair.left, pair.right))
    truth = np.linalg.inv(right[1]) @ pair.truth @ left[1]
    return DatasetPair(pair.name, pair.group, left[0], right[0], truth / truth[2, 2])


def _render_pair(flight: Flight, index: int) -> DatasetPair:
    left, right = flight.images[index], flight.images[index + 1]
    rotation_deg = abs(flight.poses[index + 1].heading_deg - flight.poses[index].heading_deg)
    group = "along a leg" if rotation_deg < 90 else "turned round"
    return DatasetPair(f"rendered {index}-{index + 1}", group, left, right, flight.homography_between(index, index + 1))
