"""How much work a pair gets: one pass of the front end where that is enough, more frames where it is not.

A pass matches a frame of one image with a frame of the other. The first pass takes the images as they are. A weak
result gets more passes, in this order: both images √2 times larger (and smaller), one image reduced in steps for
large zooms, one image compressed as if seen from the side. All go through the same front end and matcher. A homography
is accepted by the matches of these unguided passes alone.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from golden_model.arrays import Mask, Matrix, Pixels, Records
from golden_model.config import Config
from golden_model.feature.orientation import SECTORS
from sim.backends.interface import Backend
from skymosaic.features.frames import Change, Frame, make_frame, map_matches_to_images, map_to_image, swap_sides
from skymosaic.features.positions import match_points
from skymosaic.geometry import acceptance
from skymosaic.geometry.homography import apply
from skymosaic.geometry.prosac import MIN_INLIERS, Estimate, Scoring, estimate_homography

STRONG_INLIERS = 60
STRONG_SHARE = 0.25
STRONG_AGREEMENT = 0.25
"""A pass with so many inliers, spread over so much of the overlap, and such a share of the kept matches needs no other.
Where fewer of the kept matches agree, relief divides them, and more matches settle which plane counts."""
FURTHER_SAMPLES = 1000
"""Samples of the one search in a further pass; there are up to ten passes, and most pairs that need so many are
unrelated."""
FEWEST_PLACES = 12
FAR_OCTAVES = 0.19
"""Two octaves of each frame meet best where the zoom is a power of two; farther from it another ratio is tried."""


@dataclass(frozen=True)
class Run:
    """One run of the front end: a frame of one image, held as the reference, and frames of the other."""

    reference: Change
    others: tuple[Change, ...]
    exchanged: bool = False
    """The reference is made of the right image."""


LARGER, SMALLER = (Run(Change(scale), (Change(scale),)) for scale in (math.sqrt(2), math.sqrt(0.5)))
REDUCED = (Change(0.5), Change(math.sqrt(0.125)))
LADDER = tuple(Run(Change(math.sqrt(2)), REDUCED, exchanged) for exchanged in (False, True))
"""Ratios of 2.8 and 4 between the frames: with two octaves each, all zooms from 1.4 to 5.7 are near a power of two."""
TILTS = (
    Run(
        Change(),
        tuple(Change(1.0, tilt, direction) for tilt in (math.sqrt(2), 2.0) for direction in (0.0, 60.0, 120.0)),
        exchanged=True,
    ),
)
"""The left image compressed in three directions. Where it is itself the tilted one, compressing it across its own
tilt makes it smaller as a whole, which the octaves absorb."""


@dataclass(frozen=True, eq=False)
class Evidence:
    """Features and matches of all passes so far, in pixels of the working images.

    Attributes
    ----------
    features : tuple of structured arrays
        Of all frames of left and right, the first pass's first.
    matches : structured array
        Of all passes; their indices refer to ``features``.
    """

    features: tuple[Records, Records]
    matches: Records

    def with_pass(self, left: Records, right: Records, matches: Records) -> Evidence:
        """This and another pass, whose features come behind."""
        moved = matches.copy()
        for side, features in zip(("left", "right"), self.features, strict=True):
            moved[f"{side}_index"] += len(features)
        both = tuple(np.concatenate(pair) for pair in zip(self.features, (left, right), strict=True))
        return Evidence((both[0], both[1]), np.concatenate((self.matches, moved)))

    @property
    def kept(self) -> Records:
        """The matches that the fuzzy stage keeps."""
        kept: Records = self.matches[self.matches["verdict"] == 1]
        return kept


@dataclass(frozen=True, eq=False)
class Found:
    """What the passes gave: the evidence, and the homography in working px with its inliers among all matches."""

    evidence: Evidence
    homography: Matrix | None
    inliers: Mask
    places: int
    passes: int


class Search:
    """Passes over one pair of working images, each adding to the evidence."""

    def __init__(
        self,
        front_end: Backend,
        images: tuple[Pixels, Pixels],
        config: Config,
        rng: np.random.Generator,
        counted: Callable[[Records], Records],
        *,
        scoring: Scoring | None = None,
    ) -> None:
        """``counted`` returns those of the match records that count: none in what a lens masks."""
        self._front_end, self._images, self._config, self._rng = front_end, images, config, rng
        self._counted = counted
        self._scoring = scoring
        self._sizes = tuple((image.shape[1], image.shape[0]) for image in images)

    def run(self, effort: str, found: Found) -> Found:
        """Go on from the first pass as far as ``effort`` says and the pair needs."""
        if effort == "fast" or (effort == "normal" and self._strong(found)):
            return found
        found = self._union(found, (LARGER, SMALLER) if effort == "thorough" else (LARGER,))
        if self._strong(found):
            return found
        if found.homography is not None:
            run = _between_octaves(found.homography, self._sizes[0])
            return self._best_pass(found, (run,)) if run else found
        for runs in (LADDER, TILTS):
            found = self._best_pass(found, runs)
            if found.homography is not None:
                break
        return found

    def _union(self, found: Found, runs: Sequence[Run]) -> Found:
        """Add frames of the same scale on both sides and search all matches together."""
        evidence, passes = found.evidence, found.passes
        for single in self._passes(runs):
            evidence, passes = evidence.with_pass(*single.features, single.matches), passes + 1
        starts = [] if found.homography is None else [found.homography]
        return self._judged(evidence, self._estimate(evidence, starts=starts), passes)

    def _best_pass(self, found: Found, runs: Sequence[Run]) -> Found:
        """Search every pass by itself: among the matches of all, the few right ones of one would not be found.

        Of passes that are good by themselves the best is fitted to the matches of all.
        """
        evidence, passes, starts = found.evidence, found.passes, []
        for single in self._passes(runs):
            passes += 1
            alone = self._judged(single, self._estimate(single, max_samples=FURTHER_SAMPLES, restarts=1), 1)
            if alone.homography is not None:
                starts.append(alone.homography)
                evidence = evidence.with_pass(*single.features, single.matches)
        if not starts:
            return Found(found.evidence, found.homography, found.inliers, found.places, passes)
        starts += [] if found.homography is None else [found.homography]
        return self._judged(evidence, self._estimate(evidence, restarts=0, starts=starts), passes)

    def _passes(self, runs: Sequence[Run]) -> Iterator[Evidence]:
        """Features and matches of each pass, in pixels of the working images."""
        for run in runs:
            of_reference, of_others = self._images[::-1] if run.exchanged else self._images
            reference = make_frame(of_reference, run.reference)
            others = [frame for frame in (make_frame(of_others, change) for change in run.others) if frame]
            if reference is None or not others:
                continue
            frames = [reference, *others]
            results = self._front_end.run([frame.pixels for frame in frames], self._config)
            for frame, result in zip(others, results[1:], strict=True):
                features = results[0].features, result.features
                yield self._in_images(features, result.matches, (reference, frame), run.exchanged)

    def _in_images(
        self, features: tuple[Records, Records], matches: Records, frames: tuple[Frame, Frame], exchanged: bool
    ) -> Evidence:
        images = self._images
        if exchanged:
            features, frames, matches = features[::-1], frames[::-1], swap_sides(matches)
            for name in ("turn", "peak_turn"):
                matches[name] = -matches[name].astype(np.int16) % SECTORS
        moved = tuple(map_to_image(found, frame.to_image) for found, frame in zip(features, frames, strict=True))
        return Evidence((moved[0], moved[1]), self._counted(map_matches_to_images(matches, frames, images)))

    def judged(self, evidence: Evidence, homography: Matrix | None, inliers: Mask, passes: int) -> Found:
        """A homography with its inliers among all matches of the evidence; None where it is not accepted."""
        left, right = match_points(evidence.matches[inliers])
        places = acceptance.count_places(left, right)
        if homography is not None and places < FEWEST_PLACES:
            homography = None
        if homography is not None and not acceptance.spread_enough(homography, left, right, *self._sizes):
            homography = None
        return Found(evidence, homography, inliers, places, passes)

    def _judged(self, evidence: Evidence, estimate: Estimate, passes: int) -> Found:
        inliers = np.zeros(len(evidence.matches), dtype=bool)
        inliers[evidence.matches["verdict"] == 1] = estimate.inliers
        return self.judged(evidence, estimate.homography, inliers, passes)

    def _estimate(self, evidence: Evidence, *, starts: Sequence[Matrix] = (), **search: int) -> Estimate:
        kept = evidence.kept
        left, right = match_points(kept)
        weight = kept["weight"].astype(np.float64)
        return estimate_homography(left, right, weight, rng=self._rng, starts=starts, scoring=self._scoring, **search)

    def _strong(self, found: Found) -> bool:
        if found.homography is None or found.places < STRONG_INLIERS:
            return False
        if np.count_nonzero(found.inliers) < STRONG_AGREEMENT * len(found.evidence.kept):
            return False
        left, _ = match_points(found.evidence.matches[found.inliers])
        return acceptance.hull_share(found.homography, left, *self._sizes) >= STRONG_SHARE


def why_not(found: Found) -> str:
    """Why a pair was refused, with the counts."""
    features, kept = [len(side) for side in found.evidence.features], len(found.evidence.kept)
    counts = f"features {features[0]} and {features[1]}, matches {len(found.evidence.matches)}, "
    counts += f"kept {kept}, inliers {found.places}"
    if min(features) < MIN_INLIERS:
        cause = "too few features (flat or blurred image?)"
    elif kept < MIN_INLIERS:
        cause = "too few matches (do the images overlap?)"
    elif found.places < FEWEST_PLACES:
        cause = f"too few inliers, {FEWEST_PLACES} needed (do the images overlap?)"
    else:
        cause = "the inliers cover too little of the overlap"
    return f"{cause}: {counts}"


def _between_octaves(homography: Matrix, left_size: tuple[int, int]) -> Run | None:
    """The run of the ladder whose frames differ by about the zoom between the images, where the first pass's do not."""
    x, y = (left_size[0] - 1) / 2, (left_size[1] - 1) / 2
    centre, across, down = apply(homography, [[x, y], [x + 1, y], [x, y + 1]])
    (a, b), (c, d) = across - centre, down - centre
    area = abs(float(a * d - b * c))
    octaves = 0.5 * math.log2(area) if area > 0 and math.isfinite(area) else 0.0
    # Octaves are one apart in each frame, so zooms of 1/2, 1 and 2 meet in the first pass.
    if abs(octaves - round(octaves)) <= FAR_OCTAVES and abs(octaves) < 1 + FAR_OCTAVES:
        return None
    offsets = [abs(octaves) - math.log2(math.sqrt(2) / change.scale) for change in REDUCED]
    reduced = REDUCED[int(np.argmin([abs(offset - round(offset)) for offset in offsets]))]
    # Where the right image shows more detail it is the one that is reduced.
    return Run(Change(math.sqrt(2)), (reduced,), exchanged=octaves < 0)
