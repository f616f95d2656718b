"""How far to trust a registered pair: what speaks for it and against it, and one fitted table that reads both.

Matches tell whether a homography fits where they are. The pictures tell more: whether the ground that both show agrees,
block by block, and whether it would agree elsewhere as well. `measure_evidence` asks both, `judge` reads the table,
which `python -m bench.confidence` fits to pairs whose truth is exact.
"""

import json
from collections.abc import Callable
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from golden_model.arrays import Array, Matrix, Points
from skymosaic.common.brief import brief
from skymosaic.common.errors import InputError
from skymosaic.geometry.ground import (
    COARSE_SIDE_PX,
    SIDES_PX,
    STILL,
    Sight,
    count_agreeing,
    find_unmoved,
    lay_over,
    measure_rival,
)
from skymosaic.geometry.uncertainty import FitQuality, assess_fit

TABLE = Path(__file__).with_name("confidence.json")
FORMAT = 1
GOOD_PX, POOR_PX = 2.0, 5.0
"""A pair is good below the first predicted error, and poor from the second on."""
MAX_DOUBT_OF_GOOD, MAX_DOUBT = 0.01, 0.12
"""Doubt up to which a pair may be good, and above which it is refused."""
MAX_STILL = 0.15
"""By chance, one block in nine agrees at the same pixels although the camera has moved. Where more do, they may be of a
display or of watermarks; a pair that exceeds it by chance loses a few of its votes, right and wrong ones alike."""


@dataclass(frozen=True)
class Evidence(FitQuality):
    """What speaks for a homography between two working images, and what against it: the matches, and the pictures.

    Attributes
    ----------
    motion : float
        Mean motion of the picture's corners, as a share of its longer side.
    ground_share : float
        Share of the ground that agrees, of what can tell, in pictures of 480 px; a half where too little can. What
        agrees at the same pixels although the camera has moved is no ground.
    ground_lack : float
        How much more of the ground a camera that moved so far should see agree; 0 where enough agrees. What cannot tell
        counts as well where the camera stood still: a display over nothing looks like lamps at night.
    rival : float
        Correlation of the overlap at its best place elsewhere, as a share of that where it is.
    """

    motion: float
    ground_share: float
    ground_lack: float
    rival: float


@brief
@dataclass(frozen=True)
class Confidence:
    """How far a pair can be trusted.

    Attributes
    ----------
    verdict : {"good", "check", "poor"}
    reason : str
        Why it is not good; the evidence where it is.
    predicted_px : float
        Mean error over the overlap that nine of ten such pairs stay below, px of the working images.
    doubt : float
        Probability that the pair is more than 20 px off, 0 to 1.
    evidence : Evidence
    """

    verdict: str
    reason: str
    predicted_px: float
    doubt: float
    evidence: Evidence

    @property
    def is_refused(self) -> bool:
        """Whether the doubt is so large that the pair is not delivered."""
        return self.doubt > MAX_DOUBT

    def summary(self) -> dict[str, Any]:
        """All numbers by name, ready for JSON."""
        values = {"predicted_px": self.predicted_px, "doubt": self.doubt, **asdict(self.evidence)}
        return {"verdict": self.verdict, "reason": self.reason} | {key: round(v, 4) for key, v in values.items()}


def measure_evidence(sights: tuple[Sight, Sight], homography: Matrix, left: Points, right: Points) -> Evidence:
    """Measure what speaks for a homography and against it.

    Parameters
    ----------
    sights : tuple of Sight
        Left and right working image.
    homography : (3, 3) ndarray
        Left to right, working px.
    left, right : (N, 2) ndarray
        The kept matches, including wrong ones, working px.
    """
    quality = assess_fit(homography, left, right, *(sight.size for sight in sights))
    overlays = [lay_over(side_px, *sights, homography) for side_px in SIDES_PX]
    counts = [count_agreeing(overlay) for overlay in overlays]
    if counts[-1].motion >= STILL and _share_at_same_pixels(*sights) > MAX_STILL:
        counts = [count_agreeing(overlay, find_unmoved(overlay, *sights)) for overlay in overlays]
    finest = counts[-1]
    shares = [count.share for count in counts] + [finest.covered] * (finest.motion < STILL)
    return Evidence(
        **asdict(quality),
        motion=finest.motion,
        ground_share=finest.share if finest.tells else 0.5,
        ground_lack=max(finest.required - min(shares), 0.0),
        rival=measure_rival(overlays[1]),
    )


def _share_at_same_pixels(left: Sight, right: Sight) -> float:
    """Share of the blocks that agree at the same pixels; 0 for pictures of two sizes, which have none in common."""
    return count_agreeing(lay_over(COARSE_SIDE_PX, left, right, np.eye(3))).share if left.size == right.size else 0.0


class _Input(NamedTuple):
    """One input of the table: between its knots, both logarithms are interpolated; none rises."""

    at: Array
    log_odds: Array
    log_error: Array


class Table(NamedTuple):
    """Doubt and predicted error by the evidence: sums over the inputs, which are monotone each."""

    inputs: dict[str, _Input]
    log_odds: float
    errors: tuple[Array, Array]
    """Sums of `log_error`, rising, and the predicted error of each, px."""

    def predict(self, evidence: Evidence) -> tuple[float, float, str]:
        """Doubt, predicted error in px, and the cause: what raises them most over its best."""
        odds, error, worst, cause = self.log_odds, 0.0, -1.0, ""
        for name, (at, log_odds, log_error) in self.inputs.items():
            value = getattr(evidence, name)
            costs, errors = (float(np.interp(value, at, each)) for each in (log_odds, log_error))
            odds, error = odds + costs, error + errors
            loss = costs - float(log_odds.min()) + errors - float(log_error.min())
            if name in _WORDS:
                worst, cause = max((worst, cause), (loss, name))
        return float(1 / (1 + np.exp(-odds))), float(np.interp(error, *self.errors)), cause


@cache
def read_table(path: Path = TABLE) -> Table:
    """Read the fitted table.

    Raises
    ------
    InputError
        For one that is damaged or of another version.
    """
    try:
        stored = json.loads(path.read_text())
        if stored["format"] != FORMAT:
            raise InputError(f"{path}: a table of version {stored['format']}, not {FORMAT}; install skymosaic again")
        inputs = {
            name: _Input(*(np.array(each[key], float) for key in _Input._fields))
            for name, each in stored["inputs"].items()
        }
        return Table(inputs, float(stored["log_odds"]), (np.array(stored["sums"]), np.array(stored["errors_px"])))
    except (KeyError, TypeError, ValueError, OSError) as error:
        raise InputError(f"{path}: damaged ({error!r}); install skymosaic again") from None


def judge(evidence: Evidence, width_px: int) -> Confidence:
    """What the table says of a pair whose left working image is so wide."""
    doubt, predicted_px, cause = read_table().predict(evidence)
    verdict = name_verdict(doubt, predicted_px)
    words = _WORDS["held_out_share" if verdict == "good" else cause](evidence)
    reason = f"{words}; expected error {predicted_px:.1f} px at a width of {width_px} px"
    return Confidence(verdict, reason, predicted_px, doubt, evidence)


def name_verdict(doubt: float, predicted_px: float) -> str:
    """The verdict by doubt and predicted error: "good", "check" or "poor"."""
    if doubt <= MAX_DOUBT_OF_GOOD and predicted_px < GOOD_PX:
        return "good"
    return "check" if doubt <= MAX_DOUBT and predicted_px < POOR_PX else "poor"


_WORDS: dict[str, Callable[[Evidence], str]] = {
    "held_out_share": lambda it: f"{100 * it.held_out_share:.0f} % of held-out matches within 2 px",
    "hull_share": lambda it: f"inliers cover {100 * it.hull_share:.0f} % of the overlap",
    "motion": lambda it: (
        f"the camera moved by only {100 * it.motion:.2f} % of the picture: it stands on a tripod, or a watermark, a "
        "display or a sensor's pattern is what agrees"
    ),
    "ground_share": lambda it: f"{100 * it.ground_share:.0f} % of the ground agrees",
    "ground_lack": lambda it: (
        f"{100 * it.ground_lack:.0f} % of the ground more should agree for a camera that moved by "
        f"{100 * it.motion:.0f} % of the picture: mask what moves with it (display, border, dirt); or water or cars "
        "move, or nothing overlaps"
    ),
    "rival": lambda it: f"the ground repeats itself: it fits elsewhere {it.rival:.2f} times as well",
}
"""The evidence in words, by the input of the table. Of inliers there could always be more; they are counted anyway."""
