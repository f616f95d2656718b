"""The result of a registration: two photographs, their matches, and the homography between them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from golden_model.arrays import Array, Matrix, Pixels, Points, Records
from golden_model.config import Config
from golden_model.formats import WEIGHT
from golden_model.text import one_line
from skymosaic.common.brief import brief
from skymosaic.common.errors import InputError
from skymosaic.common.tables import Table
from skymosaic.features.methods import Method
from skymosaic.features.positions import match_points
from skymosaic.geometry.ground import Sight
from skymosaic.geometry.homography import apply, rescale, transfer_error
from skymosaic.geometry.prosac import INLIER_PX
from skymosaic.imagery.images import Photograph, without_channels
from skymosaic.imagery.notebook import describe_in_html, draw_lines
from skymosaic.registration.confidence import Confidence, Evidence, judge, measure_evidence

KINDS = ("inliers", "kept", "matches")
"""Kinds of matches that `Pair.points` returns, the strictest first."""


@brief
class MatchedPoints(NamedTuple):
    """Matches of two photographs.

    Attributes
    ----------
    left, right : ndarray of float64, shape (N, 2)
        Positions (x, y) in original pixels, pixel centres at integers.
    weights : ndarray of float64, shape (N,)
        Weights that the fuzzy rules give, 0 to 1.
    rules : ndarray of str, shape (N,)
        The dominant rule of each match, in words.
    """

    left: Points
    right: Points
    weights: Array
    rules: NDArray[np.str_]


@dataclass(frozen=True, repr=False, eq=False)
class Pair:
    """Two photographs, their features and matches, and their homography.

    `points` returns the matches in pixels of the photographs. A pickled pair has all its numbers but no pixels.

    The records below are those of the front end:
    positions in 1/16 px of the working images (UQ12.4), distances in bits of the descriptor (UQ16.0), weights in
    1/256 (UQ0.8) and orientations in sixteenths of a circle.

    Attributes
    ----------
    left, right : Photograph
        The originals.
    to_original : tuple of ndarray, shape (3, 3)
        Working pixels to original pixels, left and right.
    working : tuple of ndarray
        The images that the front end processed.
    visible : tuple of (ndarray of uint8 or None)
        255 where these show ground, (H, W); None: everywhere.
    features : tuple of structured arrays
        Feature records, left and right (`golden_model.records.feature_record`), in 1/16 working px.
    matches, kept, inliers : structured arrays
        Match records (`golden_model.records.MATCH`). ``matches`` are proposed by the mutual check, or by a ratio
        test before it. ``kept`` pass the fuzzy stage, or the mutual check after the ratio test. ``inliers`` lie within
        2 working px of the homography, or are accepted by the rules of fuzzy RANSAC.
    refined_inliers : int
        Grid points of the dense flow within 2 working px; 0 without a refit, or where it does not fit better.
    homography : ndarray of float64, shape (3, 3), or None
        Left original pixels to right original pixels, pixel centres at integers; None where not accepted.
    reason : str
        Why the pair was not accepted, with the counts; empty where it was.
    config : Config
        What the front end and the matcher computed.
    method : Method
        Detector and descriptor.
    estimator : str
        Robust estimator.
    effort : str
        One of `skymosaic.registration.options.EFFORTS`.
    passes : int
        Pairs of frames that were matched; 1 where the first pass was enough.
    inverted : bool
        The right photograph matches only as its negative, which ``working`` holds.
    backend : str
        Name of the backend that computed features and matches.
    seconds : dict
        Wall time of each stage.
    known_evidence : Evidence or None
        What speaks for the homography, where ``working`` is not what tells it; None: measured in that.
    """

    left: Photograph
    right: Photograph
    to_original: tuple[Matrix, Matrix]
    working: tuple[Pixels, Pixels]
    visible: tuple[Pixels | None, Pixels | None]
    features: tuple[Records, Records]
    matches: Records
    kept: Records
    inliers: Records
    refined_inliers: int
    homography: Matrix | None
    reason: str
    config: Config
    method: Method
    estimator: str
    effort: str
    passes: int
    inverted: bool
    backend: str
    seconds: dict[str, float]
    known_evidence: Evidence | None = None

    @property
    def accepted(self) -> bool:
        """Whether there is a homography."""
        return self.homography is not None

    @property
    def sights(self) -> tuple[Sight, Sight]:
        """The working images, and where they show ground."""
        return Sight(self.working[0], self.visible[0]), Sight(self.working[1], self.visible[1])

    @property
    def working_homography(self) -> Matrix | None:
        """The homography between the working images, (3, 3); None where not accepted."""
        if self.homography is None:
            return None
        return np.asarray(np.linalg.inv(self.to_original[1]) @ self.homography @ self.to_original[0])

    def with_homography(self, working: Matrix, refined_inliers: int) -> Pair:
        """This pair with another homography between the working images, whose inliers are counted anew."""
        inlier = transfer_error(working, *match_points(self.kept)) <= INLIER_PX
        homography = map_to_originals(working, self.to_original)
        inliers = self.kept[inlier]
        unknown = replace(self, known_evidence=None)
        return replace(unknown, homography=homography, inliers=inliers, refined_inliers=refined_inliers)

    def refused(self, reason: str) -> Pair:
        """This pair without a homography."""
        unknown = replace(self, known_evidence=None)
        return replace(unknown, homography=None, refined_inliers=0, reason=reason)

    @cached_property
    def evidence(self) -> Evidence | None:
        """What speaks for the homography and against it; computed on first use. None where not accepted."""
        homography = self.working_homography
        if homography is None or self.known_evidence is not None:
            return self.known_evidence
        return measure_evidence(self.sights, homography, *match_points(self.kept))

    @cached_property
    def confidence(self) -> Confidence | None:
        """How far to trust the homography by the evidence. None where not accepted."""
        return None if self.evidence is None else judge(self.evidence, self.working[0].shape[1])

    def points(self, kind: str = "inliers") -> MatchedPoints:
        """The matches in pixels of the original photographs.

        Parameters
        ----------
        kind : {"inliers", "kept", "matches"}
            Within 2 working px of the homography; after the fuzzy stage; as proposed, rejected ones included.

        Raises
        ------
        InputError
            For another kind.

        Examples
        --------
        >>> from sim.scene import make_pair
        >>> from skymosaic import register
        >>> pair = register(*make_pair(seed=5, size=(320, 240)).images)
        >>> left, right, weights, rules = pair.points()
        >>> left.shape == right.shape == (len(pair.inliers), 2)
        True
        >>> bool(0 <= weights.min() <= weights.max() <= 1)
        True
        """
        if kind not in KINDS:
            raise InputError(f"kind is {kind!r}; valid: {', '.join(KINDS)}")
        records: Records = getattr(self, kind)
        left, right = (
            apply(to_original, points)
            for to_original, points in zip(self.to_original, match_points(records), strict=True)
        )
        names = np.array(self.method.rule_names(self.config))
        return MatchedPoints(left, right, records["weight"] / WEIGHT.one, names[records["rule"]])

    def table(self, kind: str = "inliers") -> Table:
        """A row for each match, in original pixels, for pandas, polars or `csv`; errors of a refused pair are NaN.

        Parameters
        ----------
        kind : str
            As in `points`, which also says what is raised.
        """
        left, right, weights, rules = self.points(kind)
        mapped = np.full_like(left, np.nan) if self.homography is None else apply(self.homography, left)
        return {
            **{"left_x": left[:, 0], "left_y": left[:, 1], "right_x": right[:, 0], "right_y": right[:, 1]},
            "error_px": np.linalg.norm(mapped - right, axis=1),
            "weight": weights,
            "rule": rules,
        }

    def row(self) -> dict[str, Any]:
        """The pair as a row of `skymosaic.table_of_pairs`: numbers and texts by the names of their columns."""
        counts = ("matches", "kept", "inliers", "refined_inliers", "passes", "inverted")
        summary, trust = self.summary(), self.confidence
        entries = np.full(9, np.nan) if self.homography is None else self.homography.ravel()
        return {
            **{name: summary[name] for name in ("left", "right", "accepted", "reason")},
            "verdict": "" if trust is None else trust.verdict,
            "predicted_px": None if trust is None else trust.predicted_px,
            "left_features": len(self.features[0]),
            "right_features": len(self.features[1]),
            **{name: summary[name] for name in counts},
            "seconds": sum(self.seconds.values()),
            **{f"h{row}{column}": entries[3 * row + column - 4] for row in (1, 2, 3) for column in (1, 2, 3)},
        }

    def without_pixels(self) -> Pair:
        """This pair with all its numbers, below 1 MB."""
        left, right = self.left.without_pixels(), self.right.without_pixels()
        working, trust = (without_channels(self.working[0]), without_channels(self.working[1])), self.evidence
        return replace(self, left=left, right=right, working=working, visible=(None, None), known_evidence=trust)

    def __getstate__(self) -> dict[str, Any]:
        """Everything but the pixels, so that processes exchange little."""
        return vars(self.without_pixels())

    def _repr_html_(self) -> str:
        """Both photographs with lines between the inliers, for notebooks."""
        if not (self.left.pixels.size and self.right.pixels.size):
            return describe_in_html(repr(self))
        left, right, *_ = self.points()
        return describe_in_html(repr(self), draw_lines((self.left.pixels, self.right.pixels), (left, right)))

    def __repr__(self) -> str:
        """One line with the names, the verdict and the counts."""
        verdict = "accepted" if self.accepted else f"not accepted ({self.reason})"
        counts = f"{len(self.matches)} matches, {len(self.kept)} kept, {len(self.inliers)} inliers"
        return one_line(f"Pair({self.left.name} -> {self.right.name}: {verdict}, {counts})")

    def summary(self) -> dict[str, Any]:
        """The pair in plain numbers, as ``register --json`` prints it."""
        return {
            "left": self.left.name,
            "right": self.right.name,
            "accepted": self.accepted,
            "homography": None if self.homography is None else self.homography.tolist(),
            "features": [len(side) for side in self.features],
            "matches": len(self.matches),
            "kept": len(self.kept),
            "inliers": len(self.inliers),
            "refined_inliers": self.refined_inliers,
            "reason": self.reason,
            "notes": [f"{side.name}: {note}" for side in (self.left, self.right) for note in side.notes],
            "confidence": None if self.confidence is None else self.confidence.summary(),
            "seconds": {stage: round(value, 4) for stage, value in self.seconds.items()},
            "backend": self.backend,
            "preset": self.config.preset,
            **self.config.rules_summary(),
            "detector": self.method.detector,
            "descriptor": self.method.descriptor,
            "estimator": self.estimator,
            "effort": self.effort,
            "passes": self.passes,
            "inverted": self.inverted,
        }


def map_to_originals(working: Matrix, to_original: tuple[Matrix, Matrix]) -> Matrix:
    """A homography between working images as one between the original photographs."""
    return rescale(to_original[1] @ working @ np.linalg.inv(to_original[0]))
