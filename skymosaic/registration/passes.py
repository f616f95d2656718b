"""Searches a pair for a homography: one pass of the front end where that is enough, further passes where it is not.

A pass matches a frame of one image with a frame of the other. The first pass takes the images as they are. A weak
result gets further passes, in this order: both images √2 times larger (small ones then twice; noisy ones smaller), both
√2 times smaller, one image enlarged and the other reduced in steps, one image compressed as if seen from the side, the
quarters of both twice as large, the right image inverted. All go through the same front end and matcher. A homography
is accepted by the matches of these passes alone.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from golden_model.arrays import Mask, Matrix, Pixels, Points, Records
from golden_model.config import Config
from golden_model.matching.matcher import common_orientation, match, weigh
from sim.backends.interface import Backend
from skymosaic.features.frames import (
    Change,
    ChangedImage,
    DescribedImage,
    change_image,
    map_matches_to_images,
    map_to_image,
    swap_sides,
)
from skymosaic.features.positions import match_points
from skymosaic.geometry import acceptance
from skymosaic.geometry.held_out import clearly_better, held_out_agreement
from skymosaic.geometry.homography import transfer_error
from skymosaic.geometry.prosac import INLIER_PX, MIN_INLIERS, Estimate, estimate_homography
from skymosaic.registration import front_end_runs
from skymosaic.registration.front_end_runs import FrontEndRun

# A result above all three thresholds needs no further passes. Where fewer of the overlap's kept matches agree, relief
# divides them between planes, and more matches settle which plane counts; where half do, fewer places are enough.
STRONG_PLACES, STRONG_PLACES_OF_FLAT = 60, 20
STRONG_SHARE_OF_OVERLAP = 0.25
STRONG_SHARE_OF_KEPT, SHARE_OF_FLAT = 0.25, 0.5
# Half the size has a fifth of the corners. Where it has more of the inliers, finer corners are of noise or blur.
COARSE_SHARE = 1 / 3
# Most pairs that need many further passes are unrelated: a short search for each, and another among the best matches.
FURTHER_PASS_SAMPLES = 1000
MIN_PLACES = 12
# Inliers of quarters that moved by less of the longer side stand still.
STILL_IN_QUARTERS = 0.05
# Small frames show in a quarter of the time which tilts are worth a pass at full size: unrelated frames seldom gather
# more than the four places of a sample.
SCAN_SCALE = 0.5
SCAN_SAMPLES = 300
PROMISING_PLACES = 5
MAX_PROMISING = 2


@dataclass(frozen=True, eq=False)
class PooledMatches:
    """Features and matches of all passes so far, in pixels of the working images."""

    features: tuple[Records, Records]
    """Left and right, pass by pass."""
    matches: Records
    """Their indices refer to ``features``."""

    def with_pass(self, other: PooledMatches) -> PooledMatches:
        """These matches and those of a further pass, whose features are appended."""
        matches = other.matches.copy()
        for side, features in zip(("left", "right"), self.features, strict=True):
            matches[f"{side}_index"] += len(features)
        left, right = (np.concatenate(sides) for sides in zip(self.features, other.features, strict=True))
        return PooledMatches((left, right), np.concatenate((self.matches, matches)))

    @property
    def kept(self) -> Records:
        """The matches that the fuzzy stage keeps."""
        kept: Records = self.matches[self.matches["verdict"] == 1]
        return kept


@dataclass(frozen=True, eq=False)
class SearchState:
    """How far a search has come."""

    pooled: PooledMatches
    homography: Matrix | None
    """(3, 3): left to right, working px; None where none is accepted."""
    inliers: Mask
    """(N,): among all pooled matches."""
    places: int
    """Different places that the inliers show."""
    passes: int
    """Pairs of frames that were matched."""
    inverted: bool = False
    """The right image matches only as its negative."""

    @property
    def inlier_points(self) -> tuple[Points, Points]:
        """Positions of the inliers, left and right, working px."""
        return match_points(self.pooled.matches[self.inliers])


MatchedFrames = tuple[Change, tuple[Records, Records], tuple[ChangedImage, ChangedImage], Records]
"""What was done to the other frame; features and frames of both, the reference first; their matches."""


class Search:
    """Passes over one pair of working images, each adding to the pooled matches."""

    def __init__(
        self,
        front_end: Backend,
        images: tuple[Pixels, Pixels],
        config: Config,
        rng: np.random.Generator,
        remove_masked: Callable[[Records], Records],
        *,
        shared: tuple[DescribedImage, DescribedImage] | None = None,
    ) -> None:
        """``remove_masked`` drops the match records in what a lens masks; ``shared`` keeps features between pairs."""
        self._front_end, self._images, self._config, self._rng = front_end, images, config, rng
        self._remove_masked = remove_masked
        self._shared = shared
        self._sizes = tuple((image.shape[1], image.shape[0]) for image in images)
        self._are_small = max(max(size) for size in self._sizes) <= front_end_runs.SMALL_PX

    def run(self, effort: str, state: SearchState) -> SearchState:
        """Continue after the first pass as far as ``effort`` allows and the pair needs."""
        if effort == "fast" or (effort == "normal" and self._is_strong(state)):
            return state
        larger = front_end_runs.LARGER_OF_SMALL if self._are_small else (front_end_runs.LARGER,)
        if effort == "thorough":
            state = self._search_together(state, (*larger, front_end_runs.SMALLER))
        else:
            for scaled in (front_end_runs.SMALLER,) if is_coarse(state) else larger:
                state = state if self._is_strong(state) else self._search_together(state, (scaled,))
            if state.homography is None:
                state = self._search_together(state, (front_end_runs.SMALLER,))
        if self._is_strong(state):
            return state
        if state.homography is not None:
            run = front_end_runs.choose_run_between_octaves(state.homography, self._sizes[0])
            return self._search_separately(state, (run,)) if run else state
        state = self._search_separately(state, front_end_runs.LADDER)
        if state.homography is None:
            state = self._scan_tilts(state)
        if state.homography is None and effort == "thorough":
            state = self._search_separately(state, front_end_runs.TILTS)
        if state.homography is None and not self._are_small:
            state = self._search_quarters(state)
        if state.homography is not None:
            return state
        state = self._search_separately(state, (front_end_runs.INVERTED,))
        return replace(state, inverted=state.homography is not None)

    def accept(self, pooled: PooledMatches, homography: Matrix | None, inliers: Mask, passes: int) -> SearchState:
        """The state with this homography, or with None where its inliers are too few or too close together."""
        left, right = match_points(pooled.matches[inliers])
        places = acceptance.count_places(left, right)
        if homography is not None and places < MIN_PLACES:
            homography = None
        if homography is not None and not acceptance.spread_enough(homography, left, right, *self._sizes):
            homography = None
        return SearchState(pooled, homography, inliers, places, passes)

    def _search_together(self, state: SearchState, runs: Sequence[FrontEndRun]) -> SearchState:
        """Add passes over frames of the same scale on both sides, and search all matches together."""
        pooled, passes = state.pooled, state.passes
        for _, further in self._match_frames(runs):
            pooled, passes = pooled.with_pass(further), passes + 1
        if self._are_small:
            pooled = self._turn_alike(pooled)
        # The homography so far competes, so that further passes do not lose it.
        starts = [] if state.homography is None else [state.homography]
        found = self._accept_estimate(pooled, self._estimate(pooled, starts=starts), passes)
        return self.choose(state, found)

    def _turn_alike(self, pooled: PooledMatches) -> PooledMatches:
        """Judge the matches of all passes by one turn, which the few right ones of a single pass may miss."""
        matches, pattern = pooled.matches.copy(), self._config.front_end.pattern
        matches["peak_turn"] = common_orientation(matches["turn"], matches["distance"], matches["margin"], pattern.bits)
        return replace(pooled, matches=weigh(matches, *pooled.features, pattern, self._config.matcher))

    def choose(self, before: SearchState, found: SearchState) -> SearchState:
        """The homography of further passes, or the one before where that predicts held-out matches better."""
        if before.homography is None:
            return found
        judges = match_points(found.pooled.kept)
        kept, new = (
            held_out_agreement(state.homography, match_points(state.pooled.kept), judges)
            if state.homography is not None
            else 0.0
            for state in (before, found)
        )
        if not clearly_better(kept, new):
            return found
        near = transfer_error(before.homography, *match_points(found.pooled.matches)) <= INLIER_PX
        inliers = near & (found.pooled.matches["verdict"] == 1)
        return self.accept(found.pooled, before.homography, inliers, found.passes)

    def _scan_tilts(self, state: SearchState) -> SearchState:
        """Search small frames at many tilts, and at full size those where the most matches agree."""
        promising = []
        passes = state.passes
        for run in front_end_runs.TILTS:
            small = [replace(change, scale=SCAN_SCALE) for change in (run.reference, *run.others)]
            scan = FrontEndRun(small[0], tuple(small[1:]), run.swapped)
            for change, further in self._match_frames((scan,)):
                passes += 1
                estimate = self._estimate(further, max_samples=SCAN_SAMPLES, restarts=1)
                places = self._accept_estimate(further, estimate, 1).places
                if places >= PROMISING_PLACES:
                    full = FrontEndRun(run.reference, (replace(change, scale=1.0),), run.swapped)
                    promising.append((places, full))
        promising.sort(key=lambda each: -each[0])
        runs = [run for _, run in promising[:MAX_PROMISING]]
        return self._search_separately(replace(state, passes=passes), runs)

    def _search_quarters(self, state: SearchState) -> SearchState:
        """Search the quarters of both images, where a narrow overlap has more corners.

        Ground that stands still shows in whole frames: what stands still in quarters alone is a display or a watermark.
        """
        found = self._search_separately(state, front_end_runs.QUARTERS)
        left, right = found.inlier_points
        still = np.linalg.norm(left - right, axis=1) < STILL_IN_QUARTERS * max(self._sizes[0])
        most_stand_still = 2 * np.count_nonzero(still) > len(still)
        return replace(state, passes=found.passes) if most_stand_still else found

    def _search_separately(self, state: SearchState, runs: Sequence[FrontEndRun]) -> SearchState:
        """Search each pass separately: pooled, the few correct matches of one drown among the wrong ones of all.

        The passes that succeed are pooled, and the best of their homographies is fitted to all their matches.
        """
        pooled, passes, starts = state.pooled, state.passes, []
        for _, further in self._match_frames(runs):
            passes += 1
            estimate = self._estimate(further, max_samples=FURTHER_PASS_SAMPLES, restarts=2)
            homography = self._accept_estimate(further, estimate, 1).homography
            if homography is not None:
                starts.append(homography)
                pooled = pooled.with_pass(further)
        if not starts:
            return replace(state, passes=passes)
        starts += [] if state.homography is None else [state.homography]
        found = self._accept_estimate(pooled, self._estimate(pooled, restarts=0, starts=starts), passes)
        return self.choose(state, found)

    def _match_frames(self, runs: Sequence[FrontEndRun]) -> Iterator[tuple[Change, PooledMatches]]:
        """The matches of each pass and what was done to its frame, without frames that the front end does not take."""
        for run in runs:
            for change, features, frames, matches in self._run(run) if self._shared is None else self._share(run):
                if run.swapped:
                    yield change, self._map_to_images(features[::-1], frames[::-1], swap_sides(matches))
                else:
                    yield change, self._map_to_images(features, frames, matches)

    def _run(self, run: FrontEndRun) -> Iterator[MatchedFrames]:
        """What was done to each of the other frames, and its features, frames and matches with the reference."""
        reference_image, other_image = self._images[::-1] if run.swapped else self._images
        reference = change_image(reference_image, run.reference)
        others = [(change, frame) for change in run.others if (frame := change_image(other_image, change))]
        if reference is None or not others:
            return
        pixels = [frame.pixels for frame in (reference, *(frame for _, frame in others))]
        first, *results = self._front_end.run(pixels, self._config)
        for (change, frame), result in zip(others, results, strict=True):
            yield change, (first.features, result.features), (reference, frame), result.matches

    def _share(self, run: FrontEndRun) -> Iterator[MatchedFrames]:
        """As `_run`, with the features that the images keep."""
        assert self._shared is not None
        reference_image, other_image = self._shared[::-1] if run.swapped else self._shared
        reference = reference_image.describe(run.reference, self._front_end, self._config)
        for change in run.others:
            other = other_image.describe(change, self._front_end, self._config)
            if reference is not None and other is not None:
                features = reference[1], other[1]
                matches = match(*features, self._config.front_end.pattern, self._config.matcher)
                yield change, features, (reference[0], other[0]), matches

    def _map_to_images(
        self, features: tuple[Records, Records], frames: tuple[ChangedImage, ChangedImage], matches: Records
    ) -> PooledMatches:
        left, right = (map_to_image(side, frame.to_image) for side, frame in zip(features, frames, strict=True))
        mapped = map_matches_to_images(matches, frames, self._images)
        return PooledMatches((left, right), self._remove_masked(mapped))

    def _accept_estimate(self, pooled: PooledMatches, estimate: Estimate, passes: int) -> SearchState:
        """`accept` for an estimate, whose inliers are counted among the kept matches."""
        inliers = np.zeros(len(pooled.matches), dtype=bool)
        inliers[pooled.matches["verdict"] == 1] = estimate.inliers
        return self.accept(pooled, estimate.homography, inliers, passes)

    def _estimate(self, pooled: PooledMatches, *, starts: Sequence[Matrix] = (), **search: int) -> Estimate:
        kept = pooled.kept
        weight = kept["weight"].astype(np.float64)
        return estimate_homography(*match_points(kept), weight, rng=self._rng, starts=starts, **search)

    def _is_strong(self, state: SearchState) -> bool:
        if state.homography is None:
            return False
        x, y = np.rint(match_points(state.pooled.kept)[0]).astype(np.intp).T
        in_overlap = np.count_nonzero(acceptance.overlap_mask(state.homography, *self._sizes)[y, x])
        inliers = np.count_nonzero(state.inliers)
        places = STRONG_PLACES_OF_FLAT if inliers >= SHARE_OF_FLAT * in_overlap else STRONG_PLACES
        if state.places < places or inliers < STRONG_SHARE_OF_KEPT * in_overlap:
            return False
        left, _ = state.inlier_points
        return acceptance.hull_share(state.homography, left, *self._sizes) >= STRONG_SHARE_OF_OVERLAP


def is_coarse(state: SearchState) -> bool:
    """Whether many inliers are corners at half the size in both images, as where noise or blur hides what is finer."""
    matches = state.pooled.matches[state.inliers]
    left, right = state.pooled.features
    levels = left["level"][matches["left_index"]] & right["level"][matches["right_index"]]
    return state.homography is not None and bool(np.count_nonzero(levels) > COARSE_SHARE * len(matches))


def explain_refusal(state: SearchState) -> str:
    """Why a pair is not accepted, with the counts."""
    (left, right), kept = (len(side) for side in state.pooled.features), len(state.pooled.kept)
    if min(left, right) < MIN_INLIERS:
        cause = "too few features (flat or blurred image?)"
    elif kept < MIN_INLIERS:
        cause = "too few matches (do the images overlap?)"
    elif state.places < MIN_PLACES:
        cause = f"inliers at too few places, {MIN_PLACES} needed (do the images overlap?)"
    else:
        cause = "the inliers cover too little of the overlap"
    # Inliers at one place, of neighbouring corners, count once: both numbers, as `Pair.inliers` has the first.
    matches, inliers = len(state.pooled.matches), np.count_nonzero(state.inliers)
    counts = f"matches {matches}, kept {kept}, inliers {inliers} at {state.places} places"
    return f"{cause}: features {left} and {right}, {counts}"
