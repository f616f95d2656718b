"""Single passes over pairs, held against recorded results: what other tests allow is wide, since they say what must be.

Further passes are left out: they reduce or enlarge photographs, where processors round single pixels otherwise. Where
a change is meant, and better on public pairs, record what the failing test prints.
"""

from typing import Any

import numpy as np
import pytest

from golden_model.arrays import Pixels
from skymosaic.geometry.homography import apply
from skymosaic.registration.options import Effort
from skymosaic.registration.pair import Pair
from skymosaic.registration.register import register
from tests.system.recorded.rows import HEIGHT_PX, WIDTH_PX, as_pixels, check_recorded, view, with_hills


def make(kind: str) -> tuple[Pixels, Pixels]:
    left, right = view(300, 300)[0], view(380, 330, 0.2)[0]
    match kind:
        case "shifted":
            right = view(350, 325)[0]
        case "zoom":
            right = view(330, 310, 0.5, 1.3)[0]
        case "tilt":
            right = view(330, 310, 0.1, 1.0, 0.0008)[0]
        case "small":
            left, right = left[:100, :130], view(300, 300, 0.1)[0][10:110, 15:150]
        case "edge":
            right = view(480, 325, 0.05)[0]
        case "hills":
            right = with_hills(right, 7)
        case "low hills":
            right = with_hills(right, 4)[:200]
        case "elsewhere":
            right = view(600, 500)[0][:, ::-1]
    return as_pixels(left), as_pixels(right)


def measure(pair: Pair) -> list[float]:
    """Passes, counts, what is known of the quality, and where the corners go."""
    counts: list[float] = [pair.passes, *(len(each) for each in (pair.matches, pair.kept, pair.inliers))]
    counts += [pair.refined_inliers, pair.inverted]
    trust = pair.confidence
    if trust is None or pair.homography is None:
        return counts
    corners = np.array([(0.0, 0), (WIDTH_PX, 0), (WIDTH_PX, HEIGHT_PX), (0, HEIGHT_PX)])
    quality = [trust.predicted_px, trust.doubt, trust.evidence.ground_share, trust.evidence.hull_share]
    return [*counts, *quality, *apply(pair.homography, corners).ravel().tolist()]


def check(name: str, pair: Pair) -> None:
    check_recorded(name, measure(pair), 0.01)


@pytest.mark.parametrize(
    ("kind", "effort"),
    [
        ("plain", "normal"), ("hills", "normal"), ("low hills", "normal"), ("hills", "fast"), ("zoom", "fast"),
        ("tilt", "fast"), ("small", "fast"), ("edge", "fast"), ("elsewhere", "fast"),
    ],
)  # fmt: skip
def test_pairs_end_as_recorded(kind: str, effort: Effort) -> None:
    check(f"{kind}, {effort}", register(*make(kind), effort=effort))


@pytest.mark.parametrize(
    "options",
    [
        {"preset": "thesis"}, {"estimator": "fabric"}, {"estimator": "fuzzy-ransac"}, {"detector": "fast"},
        {"detector": "surf", "descriptor": "window-22"}, {"descriptor": "ilbp-256-upright"},
        {"descriptor": "thesis-ilbp-3"},
    ],
    ids=lambda options: "-".join(options.values()),
)  # fmt: skip
def test_methods_end_as_recorded(options: dict[str, Any]) -> None:
    check("-".join(options.values()), register(*make("shifted"), **options))
