"""Finds the stage where hardware and golden model differ, with a build of the front end that outputs every stage."""

import numpy as np

from golden_model.arrays import Pixels, Records
from golden_model.config import Config, FrontEndConfig
from golden_model.front_end import trace
from hdl.settings import frame_settings
from sim.backends.interface import Mismatch, Progress, silent
from sim.simulators.accelerator_designs import choose_build, design_front_end
from sim.simulators.front_end_top import TAP_WORD, Tap
from sim.simulators.recording import Segment, flatten_frame
from sim.simulators.scoreboard import find_stage_mismatch
from sim.simulators.verilator import simulate


def locate_mismatch(
    image: Pixels, config: FrontEndConfig, *, frame: int = 0, progress: Progress = silent
) -> Mismatch | None:
    """The first stage of the front end, level by level, whose plane differs from `golden_model.front_end.trace`.

    None if all planes are equal: then the difference arises after the corner candidates. See
    `sim.backends.interface.Backend.locate`.
    """
    height_px, width_px = image.shape[:2]
    data, flags = flatten_frame(image)
    values = frame_settings(config, width_px, height_px, gray_input=image.ndim == 2)
    segment = Segment(data, flags, packets=1, cycle_limit=4 * data.size, settings=values)
    golden = trace(image, config)
    taps = tuple(Tap(number, name) for number, level in enumerate(golden.levels) for name in level)
    design = design_front_end(choose_build(Config(front_end=config), [image]), taps=taps)
    (recording,) = simulate(design, [segment], progress=progress)
    planes: list[dict[str, np.ma.MaskedArray]] = [{} for _ in golden.levels]
    for tap in taps:
        words = recording.taps[tap.port].view(TAP_WORD)
        planes[tap.level][tap.stage] = _place_values(words, (height_px >> tap.level, width_px >> tap.level))
    return find_stage_mismatch(golden, planes, frame=frame)


def _place_values(words: Records, shape: tuple[int, int]) -> np.ma.MaskedArray:
    """The values at their pixels; the other pixels are masked, since the hardware sent no value for them."""
    plane: np.ma.MaskedArray = np.ma.MaskedArray(np.zeros(shape, np.int64), mask=True)
    x, y = words["x"], words["y"]
    # Stages lag behind the scan, so their first and last beats lie outside the frame.
    inside = (x >= 0) & (y >= 0) & (x < shape[1]) & (y < shape[0])
    plane[y[inside], x[inside]] = words["value"][inside]
    return plane
