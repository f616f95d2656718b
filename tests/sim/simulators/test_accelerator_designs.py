"""Which build simulates frames."""

import numpy as np
import pytest

from golden_model.config import MAX_FRAME_PX, preset_config
from hdl.build import Build
from sim.simulators.accelerator_designs import choose_build

USUAL = Build().max_width_px, Build().max_height_px
LARGEST = MAX_FRAME_PX, MAX_FRAME_PX


@pytest.mark.parametrize(
    ("sizes", "chosen"),
    [
        ([USUAL, (64, 64)], USUAL),
        ([(64, 64), (USUAL[0] + 1, 64)], LARGEST),
        ([(64, USUAL[1] + 1), (64, 64)], LARGEST),
    ],
)
def test_frames_that_the_usual_build_cannot_take_have_one_of_their_own(
    sizes: list[tuple[int, int]], chosen: tuple[int, int]
) -> None:
    frames = [np.broadcast_to(np.uint8(0), (height, width)) for width, height in sizes]
    build = choose_build(preset_config("aerial"), frames)
    assert (build.max_width_px, build.max_height_px) == chosen
