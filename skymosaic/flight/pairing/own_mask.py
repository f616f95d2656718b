"""Finds where the photographs of a flight show what moves with the camera, by the matches that were rejected for it."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import cv2
import numpy as np

from golden_model.arrays import Array, Mask, Pixels
from golden_model.pixel.gray import to_gray
from skymosaic.features.contrast import find_pattern
from skymosaic.flight.linking.links import RELIEF_PX, Link
from skymosaic.flight.linking.view import View
from skymosaic.flight.pairing.linked_views import LinkedViews, link_all, rough_layouts
from skymosaic.geometry.homography import apply, transfer_error

MIN_VIEWS, MIN_SHARE_OF_VIEWS = 3, 0.5
"""Photographs, and share of a flight, with rejected matches: a camera that hovers over water has fewer."""
MIN_VOTES, MIN_SHARE_OF_VOTES = 2, 0.1
"""Pairs that must have rejected matches at a place."""
REACH_PX = 5
"""A match tells about what is so near, and gaps of twice that are closed, in pixels of thumbnails."""
MAX_HOLE = 0.02
"""What is masked all around and smaller than this share of a picture is masked, too."""
CONSTANT_SHARE = 0.25
"""What changes less than this share of the usual from photograph to photograph, as a border does, and joins such
places, moves with the camera, too."""
_AROUND = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * REACH_PX + 1, 2 * REACH_PX + 1))
SHARED = 5.0
"""Where what all photographs have in common has so many times the usual energy, something is drawn in them. Some of
what was voted for must be such a place: a sensor's pattern is everywhere."""
MAX_SHARE_MASKED = 0.6
"""A mask of more is none."""


def mask_own(linked: LinkedViews) -> LinkedViews:
    """Views and links again without what moves with the camera, as a mask from a file would give them.

    Where its groups would be smaller, the mask is for the picture alone. The same as before where a lens is given, or
    nothing moves with the camera.
    """
    surveyor, lens = linked.surveyor, linked.surveyor.settings.lens
    if lens.mask is not None or lens.matrix is not None or not (moving := _moving_links(linked)):
        return linked
    mask = find_mask(linked.views, moving, [view.thumbnail for view in surveyor.fetch_thumbnails(linked.views)])
    if mask is None:
        return linked
    masking = replace(surveyor, settings=replace(surveyor.settings, lens=replace(lens, mask=mask)))
    described = masking.describe_all(linked.sources)
    again = tuple(replace(view, taken=known.taken) for view, known in zip(described, linked.views, strict=True))
    masked = link_all(LinkedViews(masking, linked.sources, again, {}))
    before, after = ([len(part) for part in each.groups] for each in (linked, masked))
    if after >= before and after[0] > 1:
        return masked
    return replace(linked, surveyor=masking) if before[0] >= len(linked.views) / 2 else linked


def _moving_links(linked: LinkedViews) -> list[Link]:
    """The links with matches that move with the camera, unless the layout of the others says that they do not."""
    moving = [link for link in linked.links.values() if link.moves_with_camera]
    rough = rough_layouts(linked.views, linked.links) if moving else []
    return [link for link in moving if not any(_explains(transforms, link) for transforms in rough)]


def _explains(transforms: Mapping[int, Array], link: Link) -> bool:
    """Whether by a layout the matches that were taken for moving are ground, as below a camera that hovers."""
    if link.left not in transforms or link.right not in transforms:
        return False
    to_right = np.linalg.inv(transforms[link.right]) @ transforms[link.left]
    return bool(np.median(transfer_error(to_right, link.left_moving, link.right_moving)) < RELIEF_PX)


def find_mask(views: Sequence[View], moving: Sequence[Link], thumbnails: Sequence[Pixels]) -> Pixels | None:
    """Mask what moves with the camera, by the links with such matches and by the thumbnails of the views.

    The mask has the size of a thumbnail, 0 where that does not show the ground, else 255; None without such places, or
    for photographs of several sizes.
    """
    involved = {end for link in moving for end in (link.left, link.right)}
    sizes = {thumbnail.shape[:2] for thumbnail in thumbnails}
    if len(involved) < max(MIN_VIEWS, MIN_SHARE_OF_VIEWS * len(views)) or len(sizes) > 1:
        return None
    votes = np.sum([_places(link, views, thumbnails[0]) for link in moving], axis=0)
    voted = votes >= max(MIN_VOTES, MIN_SHARE_OF_VOTES * len(moving))
    energy = cv2.GaussianBlur(find_pattern(thumbnails) ** 2, (0, 0), REACH_PX / 2)
    shared = energy > SHARED * np.median(energy[~voted])
    masked = _join(shared, thumbnails)
    if not (voted & shared).any() or max(voted.mean(), masked.mean()) > MAX_SHARE_MASKED:
        return None
    return np.where(masked, 0, 255).astype(np.uint8)


def _places(link: Link, views: Sequence[View], thumbnail: Pixels) -> Mask:
    """Where a pair has rejected matches, in either photograph."""
    hit = np.zeros(thumbnail.shape[:2], np.uint8)
    for view, points in ((views[link.left], link.left_moving), (views[link.right], link.right_moving)):
        x, y = np.rint(apply(view.to_thumbnail, points)).astype(int).clip(0, np.subtract(hit.shape[::-1], 1)).T
        hit[y, x] = 1
    return np.asarray(cv2.dilate(hit, _AROUND) > 0)


def _join(shared: Mask, thumbnails: Sequence[Pixels]) -> Mask:
    """These places, what is constant and joins them, and what both enclose."""
    spread = np.std([to_gray(thumbnail) for thumbnail in thumbnails], axis=0)
    constant = cv2.GaussianBlur(spread, (0, 0), 1.0) < CONSTANT_SHARE * np.median(spread[~shared])
    joined = cv2.morphologyEx((shared | constant).astype(np.uint8), cv2.MORPH_CLOSE, _AROUND)
    _, labels = cv2.connectedComponents(joined)
    masked = np.isin(labels, np.setdiff1d(labels[shared], 0))
    _, labels, sizes, _ = cv2.connectedComponentsWithStats((~masked).astype(np.uint8))
    holes = np.flatnonzero(sizes[:, cv2.CC_STAT_AREA] < MAX_HOLE * masked.size)
    return np.asarray(masked | np.isin(labels, holes))
