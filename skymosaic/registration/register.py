"""Registers a pair of overlapping photographs: features, matches, homography, or why it failed."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple, Unpack

import numpy as np

from golden_model.arrays import Mask, Matrix, Pixels, Points, Records
from golden_model.config import MIN_FRAME_PX
from sim.backends.interface import Backend, Progress, silent
from skymosaic.common.options import choose_options, list_options
from skymosaic.common.stopwatch import Stopwatch
from skymosaic.features.contrast import even_contrast, find_pattern, share_pattern
from skymosaic.features.given_matches import Given, GivenMatches
from skymosaic.features.methods import Method
from skymosaic.features.positions import match_points
from skymosaic.geometry.estimators import estimate
from skymosaic.geometry.ground import MOVES_WITH_CAMERA, RIVAL_SHARE, GroundAgreement, LeftOut, Sight, find_ground
from skymosaic.imagery.images import Photograph, load, reduce_to_width
from skymosaic.imagery.lens import Lens
from skymosaic.registration.dense import refit_pair
from skymosaic.registration.display import DELIVER, look_behind_display
from skymosaic.registration.extraction import Features, share_features
from skymosaic.registration.first_pass import FirstPass, Sides, match_first, prepare, take_given
from skymosaic.registration.options import RegistrationOptions
from skymosaic.registration.pair import Pair, map_to_originals
from skymosaic.registration.passes import PooledMatches, Search, SearchState, explain_refusal

if TYPE_CHECKING:
    from skymosaic.keywords import RegistrationKeywords


FLAT_SHARE = 0.8
"""Where fewer of the held-out matches or less of the ground agree, all of the overlap tells more than its corners."""
INVERTED_NOTE = "it matches only as its negative, as thermal and infrared photographs may"


@list_options
def register(
    left: str | Path | Pixels | Features,
    right: str | Path | Pixels | Features,
    options: RegistrationOptions | None = None,
    *,
    matches: Given | None = None,
    progress: Progress = silent,
    **changes: "Unpack[RegistrationKeywords]",
) -> Pair:
    """Find the homography between two photographs.

    Parameters
    ----------
    left, right : path, ndarray of uint8, shape (H, W) or (H, W, 3) BGR, or Features
        The photographs; they need not be of one size. `Features` of `skymosaic.extract` serve all pairs of a
        photograph: whatever one pair computes of it, the next one finds. They are matched by the golden model.
    options : RegistrationOptions, optional
    matches : (left, right) or (left, right, weights), optional
        Matches of your own: positions (N, 2) in pixels of the photographs, weights (N,) from 0 to 1. They take the
        place of features and matches; estimator, checks and verdict are the same.
    progress : callable
        Receives lines about the first build of a simulation.
    **changes
        Single options by the names of `RegistrationOptions`; they take precedence over ``options``.

    Returns
    -------
    Pair
        In original pixels; with ``accepted`` False and a ``reason`` where the photographs cannot be registered.

    Raises
    ------
    skymosaic.common.errors.InputError
        For a photograph that cannot be used, an unknown name or an impossible combination; for features that other
        options gave, or of a method that only the host computes; for matches that cannot be those of the photographs.

    Examples
    --------
    >>> from sim.scene import make_pair
    >>> left, right = make_pair(seed=5, size=(320, 240)).images
    >>> pair = register(left, right, effort="fast")
    >>> pair.accepted, pair.homography.shape
    (True, (3, 3))
    """
    options = choose_options(RegistrationOptions, options, changes)
    options.check()
    clock, features = Stopwatch(), None
    given = None if matches is None else GivenMatches.read(matches)
    if isinstance(left, Features) or isinstance(right, Features):
        features = share_features(left, options, progress), share_features(right, options, progress)
        photographs = features[0].photograph, features[1].photograph
    else:
        photographs = (
            load(left, "left image", keep_damaged=options.keeps_damaged),
            load(right, "right image", keep_damaged=options.keeps_damaged),
        )
    clock.lap("reading and features" if features else "reading")
    return register_photographs(
        photographs, options, seconds=clock.seconds, features=features, given=given, progress=progress
    )


def register_photographs(
    photographs: tuple[Photograph, Photograph],
    options: RegistrationOptions,
    *,
    seconds: dict[str, float],
    lens: Lens | None = None,
    features: tuple[Features, Features] | None = None,
    given: GivenMatches | None = None,
    progress: Progress = silent,
) -> Pair:
    """`register` for photographs that are already decoded, and perhaps described, or matched by the user.

    ``seconds`` holds the time spent so far. Matches in pixels that ``lens`` masks do not count.
    """
    clock = Stopwatch(seconds)
    method, config = options.choose_method() if given is None else options.choose_given()
    effort = options.choose_effort(method)
    front_end = options.open_backend(method, progress)
    sides = prepare(photographs, options, lens or Lens(), features)
    by_user = None if given is None else take_given(given, sides, config)
    first = by_user or match_first(front_end, sides, config, options)
    clock.lap("features and matches")
    found = _search(front_end, sides, first, options, effort)
    pair = _make_pair(sides, first, found, options, method=method, effort=effort, seconds=clock.seconds)
    clock.lap("homography")
    pair = look_behind_display(pair, first.matches, accept_poor=options.accept_poor)
    pair = _settle(pair, options, partial(sides.show_ground, found.left_out))
    clock.lap("refinement")
    in_doubt = not (pair.accepted and found.is_ground)
    large = min(sides.images[0].shape[:2]) >= 2 * MIN_FRAME_PX
    if given is None and in_doubt and large and share_pattern(*pair.working):
        return _register_without_pattern(pair, options, lens, progress)
    return pair


class _Found(NamedTuple):
    """Where the search ended: a homography or none, how much of the ground agrees, and what was rejected."""

    state: SearchState
    agreement: GroundAgreement | None
    left_out: LeftOut

    @property
    def is_ground(self) -> bool:
        """Whether the ground does not disagree."""
        return self.agreement is None or self.agreement.suffices


def _search(front_end: Backend, sides: Sides, first: FirstPass, options: RegistrationOptions, effort: str) -> _Found:
    """Search, and again without what moves with the camera, where that is all that was found."""
    # One generator for all passes: a result depends on the seed alone.
    rng, shared = np.random.default_rng(options.seed), None
    if sides.features is not None:
        shared = sides.features[0].working, sides.features[1].working

    def search(left_out: LeftOut) -> tuple[SearchState, Matrix | None, tuple[Points, Points]]:
        def remove(matches: Records) -> Records:
            shown: Records = matches[sides.show_ground(left_out, *match_points(matches))]
            return shown

        passes = Search(front_end, sides.images, first.config, rng, remove, shared=shared)
        matches = remove(first.matches)
        left, right = match_points(matches)
        weight, verified = matches["weight"].astype(np.float64), matches["verdict"] == 1
        height, width = sides.images[1].shape[:2]
        record = None if left_out.rejected else first.homography
        # By any of the estimators; further passes are for PROSAC alone.
        found = estimate(options.estimator, left, right, weight, verified, size=(width, height), rng=rng, record=record)
        state = passes.run(effort, passes.accept(PooledMatches(first.features, matches), *found, passes=1))
        return state, state.homography, state.inlier_points

    def see(state: SearchState) -> tuple[Sight, Sight]:
        left, right = sides.images
        return Sight(left, sides.masks[0]), Sight(~right if state.inverted else right, sides.masks[1])

    found = _Found(*find_ground(search, see))
    # Without a rival, what was rejected is what there is.
    return found if found.agreement and found.is_ground else found._replace(left_out=LeftOut())


def _make_pair(
    sides: Sides,
    first: FirstPass,
    found: _Found,
    options: RegistrationOptions,
    *,
    method: Method,
    effort: str,
    seconds: dict[str, float],
) -> Pair:
    state, (left, right) = found.state, sides.images
    same = [f"the same picture as {sides.photographs[0].name}"] if np.array_equal(left, right) else []
    moving = [MOVES_WITH_CAMERA] if found.left_out.rejected else []
    notes = *sides.photographs[1].notes, *same, *moving, *([INVERTED_NOTE] if state.inverted else [])
    homography = None if state.homography is None else map_to_originals(state.homography, sides.to_original)
    return Pair(
        left=sides.photographs[0],
        right=replace(sides.photographs[1], notes=notes),
        to_original=sides.to_original,
        working=(left, ~right if state.inverted else right),
        visible=sides.masks,
        features=state.pooled.features,
        matches=state.pooled.matches,
        kept=state.pooled.kept,
        inliers=state.pooled.matches[state.inliers],
        refined_inliers=0,
        homography=homography,
        reason="" if homography is not None else explain_refusal(state) + _what_else(effort),
        config=first.config,
        method=method,
        estimator=options.estimator,
        effort=effort,
        passes=state.passes,
        inverted=state.inverted,
        backend=options.backend_name,
        seconds=seconds,
    )


def _settle(pair: Pair, options: RegistrationOptions, shows_ground: Callable[[Points, Points], Mask]) -> Pair:
    """Refit a pair whose matches or ground do not all agree; refuse what is in too much doubt."""
    evidence = pair.evidence
    if pair.effort != "fast" and evidence and min(evidence.held_out_share, evidence.ground_share) < FLAT_SHARE:
        pair = refit_pair(pair, shows_ground)
    if options.accept_poor or pair.confidence is None or not pair.confidence.is_refused:
        return pair
    return pair.refused(f"{pair.confidence.reason}{DELIVER}{_what_else(pair.effort)}")


def _register_without_pattern(pair: Pair, options: RegistrationOptions, lens: Lens | None, progress: Progress) -> Pair:
    """Register a pair in doubt at half size, without what both images show at the same pixels; or else return it."""
    width_px = pair.working[0].shape[1] // 2
    (left, to_left), (right, to_right) = (reduce_to_width(image, width_px) for image in pair.working)
    pattern = find_pattern((left, right))
    again = register_photographs(
        (
            replace(pair.left, pixels=even_contrast(left, pattern)),
            replace(pair.right, pixels=even_contrast(right, pattern)),
        ),
        options,
        seconds={"with the pattern": sum(pair.seconds.values())},
        lens=lens,
        progress=progress,
    )
    # What is left of the pattern in one image is its negative in the other.
    if again.homography is None or again.evidence is None or again.inverted:
        return pair
    if again.evidence.ground_lack > 0 or again.evidence.ground_share < RIVAL_SHARE:
        return pair
    to_original = pair.to_original[0] @ to_left, pair.to_original[1] @ to_right
    return replace(
        again,
        left=pair.left,
        right=replace(pair.right, notes=(*pair.right.notes, MOVES_WITH_CAMERA)),
        to_original=to_original,
        working=(left, right),
        homography=map_to_originals(again.homography, to_original),
        # Of the images without the pattern, because these have it.
        known_evidence=again.evidence,
    )


def _what_else(effort: str) -> str:
    """What may help a pair that is refused."""
    return "; `effort` thorough tries more" if effort == "normal" else ""
