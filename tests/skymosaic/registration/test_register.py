"""What a registration asks of the front end, and of what judges its result."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from golden_model.config import Config
from sim.backends.golden import GoldenBackend
from sim.backends.interface import FrameResult
from sim.scene import make_pair
from skymosaic.imagery.images import Photograph
from skymosaic.imagery.lens import Lens
from skymosaic.registration.options import RegistrationOptions
from skymosaic.registration.register import register, register_photographs

MODULE = "skymosaic.registration.register"
PIXELS = np.zeros((96, 128, 3), np.uint8)
MASK = np.full((96, 128), 255, np.uint8)
MASK[:30] = 0


class AskedError(Exception):
    """The configuration that a front end was asked to run with."""


class Asking(GoldenBackend):
    def run(self, frames: Sequence[NDArray[np.uint8]], config: Config, **options: Any) -> list[FrameResult]:
        raise AskedError(config)


@pytest.mark.parametrize("masked", ["nothing", "by the lens", "by the photograph"])
def test_what_the_hardware_would_estimate_counts_where_nothing_is_masked(masked: str) -> None:
    """It does not know the mask, which may be that of one photograph alone."""
    lens = Lens(mask=MASK) if masked == "by the lens" else None
    seen = MASK if masked == "by the photograph" else None
    photographs = Photograph("left", PIXELS), Photograph("right", PIXELS, visible=seen)
    options = RegistrationOptions(estimator="fabric", backend=Asking())
    with pytest.raises(AskedError) as asked:
        register_photographs(photographs, options, seconds={}, lens=lens)
    assert (asked.value.args[0].estimator is not None) == (masked == "nothing")


@pytest.mark.parametrize(("height_px", "shares", "asked"), [(127, True, False), (128, False, False), (128, True, True)])
def test_only_a_pair_in_doubt_is_registered_without_a_pattern(
    monkeypatch: pytest.MonkeyPatch, height_px: int, shares: bool, asked: bool
) -> None:
    """At half of the size, which must be enough for the front end."""
    again = object()
    monkeypatch.setattr(f"{MODULE}.share_pattern", lambda *_: shares)
    monkeypatch.setattr(f"{MODULE}._register_without_pattern", lambda *_: again)
    flat = np.full((height_px, 160, 3), 90, np.uint8)
    assert (register(flat, flat) is again) == asked
    left, right = make_pair(seed=5, size=(320, 240)).images
    assert register(left, right, effort="fast").accepted
