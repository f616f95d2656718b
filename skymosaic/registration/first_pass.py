"""The first pass over a pair: both photographs as they are registered, their features and their matches."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from golden_model.arrays import Mask, Matrix, Pixels, Points, Records
from golden_model.config import Config
from golden_model.matching.matcher import match
from sim.backends.interface import Backend
from skymosaic.features.given_matches import GivenMatches
from skymosaic.features.positions import are_on_ground
from skymosaic.geometry.estimators import FABRIC, fabric
from skymosaic.geometry.ground import LeftOut
from skymosaic.imagery.images import Photograph, reduce_for_front_end
from skymosaic.imagery.lens import Lens
from skymosaic.registration.extraction import Features, extract_within_capacity
from skymosaic.registration.options import RegistrationOptions


@dataclass(frozen=True, eq=False)
class Sides:
    """Left and right photograph, as they are registered."""

    photographs: tuple[Photograph, Photograph]
    images: tuple[Pixels, Pixels]
    """Reduced to the working width."""
    to_original: tuple[Matrix, Matrix]
    lenses: tuple[Lens, Lens]
    """Turned as the photographs are."""
    features: tuple[Features, Features] | None
    """Where they are described already."""

    @cached_property
    def masks(self) -> tuple[Pixels | None, Pixels | None]:
        """255 where an image shows ground; None: everywhere."""
        left, right = (
            lens.visible_mask((image.shape[1], image.shape[0]), photograph.visible)
            for lens, image, photograph in zip(self.lenses, self.images, self.photographs, strict=True)
        )
        return left, right

    def show_ground(self, left_out: LeftOut, left: Points, right: Points) -> Mask:
        """Which points (N, 2) show ground in both images: unmasked, and apart from what moves with the camera."""
        shown = (are_on_ground(*side) for side in zip((left, right), self.masks, strict=True))
        return np.logical_and(*shown) & left_out.are_apart(left, right)


def prepare(
    photographs: tuple[Photograph, Photograph],
    options: RegistrationOptions,
    lens: Lens,
    features: tuple[Features, Features] | None,
) -> Sides:
    """Reduce both photographs to the working width; those with ``features`` are reduced already."""
    (left, to_left), (right, to_right) = (
        [reduce_for_front_end(each.pixels, options.working_width_px, each.name) for each in photographs]
        if features is None
        else [(each.working.image, each.to_original) for each in features]
    )
    lenses = lens.turned(photographs[0].orientation), lens.turned(photographs[1].orientation)
    return Sides(photographs, (left, right), (to_left, to_right), lenses, features)


class FirstPass(NamedTuple):
    """Features and matches of the working images, the configuration they took, and a homography from the hardware."""

    features: tuple[Records, Records]
    matches: Records
    config: Config
    homography: np.void | None = None


def match_first(front_end: Backend, sides: Sides, config: Config, options: RegistrationOptions) -> FirstPass:
    """Match the working images, by the features that they may have already, or by those of the front end."""
    # A threshold that was raised for one photograph alone is raised for both.
    if (features := sides.features) and features[0].config.front_end == features[1].config.front_end:
        config = replace(config, front_end=features[0].config.front_end)
        records = features[0].records, features[1].records
        return FirstPass(records, match(*records, config.front_end.pattern, config.matcher), config)
    # The hardware does not know what is masked.
    if options.estimator == FABRIC and all(mask is None for mask in sides.masks):
        config = replace(config, estimator=fabric.draw_config(np.random.default_rng(options.seed)))
    # The left frame is held as the reference, so the matches come with the right one.
    (left, right), config = extract_within_capacity(front_end, list(sides.images), config)
    return FirstPass((left.features, right.features), right.matches, config, right.homography)


def take_given(given: GivenMatches, sides: Sides, config: Config) -> FirstPass:
    """The user's matches in the place of features and matches."""
    each = zip((each.size for each in sides.photographs), sides.to_original, sides.lenses, strict=True)
    return FirstPass(*given.records(config.front_end.pattern.record.dtype, list(each)), config)
