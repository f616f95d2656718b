"""Random narrow frames without pauses: every clock that is predicted is the one simulated."""

import contextlib
import dataclasses

import cv2
import numpy as np
import pytest

from golden_model.config import CELL_SIZES_PX, MAX_PER_CELL, PRESETS
from sim.backends.interface import load_backend
from sim.simulators import verilator
from sim.simulators.accelerator_designs import design_accelerator
from sim.simulators.compiled import Bench
from sim.simulators.hardware import decode_recordings, make_segments
from sim.simulators.scoreboard import find_clock_mismatch, find_mismatch, predict_timelines

BUILT_PX, LANES, RUNS = 256, 4, 60
PRESET = PRESETS["aerial"]
CONFIG = dataclasses.replace(PRESET, front_end=dataclasses.replace(PRESET.front_end, max_features=256))


@pytest.mark.slow
def test_clocks_of_narrow_frames_are_predicted_or_left_out() -> None:
    rng = np.random.default_rng(5)
    noise = rng.integers(0, 256, (400, 400)).astype(np.float32)
    smooth = cv2.GaussianBlur(noise, (0, 0), 1.5)
    texture = cv2.normalize(smooth, smooth, 0, 255, cv2.NORM_MINMAX).astype(np.uint8)
    design = design_accelerator(CONFIG, (BUILT_PX, BUILT_PX), lanes=LANES)
    library = verilator.build_library(design, progress=print)
    predicted = 0
    for _ in range(RUNS):
        width_px, height_px = rng.integers(64, BUILT_PX + 1, 2).tolist()
        cell_px = int(rng.choice(CELL_SIZES_PX))
        fitting = CONFIG.front_end.max_features // CONFIG.front_end.count_cells(width_px, height_px, cell_px)
        front_end = dataclasses.replace(
            CONFIG.front_end,
            threshold=int(10 ** rng.uniform(0, 5)),
            cell_px=cell_px,
            per_cell=int(rng.integers(1, min(fitting, MAX_PER_CELL) + 1)),
        )
        config = dataclasses.replace(CONFIG, front_end=front_end)
        x, y = rng.integers(0, 100, 2)
        frames = [
            np.ascontiguousarray(texture[y + 2 * n : y + 2 * n + height_px, x + 3 * n : x + 3 * n + width_px])
            for n in range(3)
        ]
        with contextlib.closing(Bench(library, design.ports)) as bench:
            results = decode_recordings([bench.run(each) for each in make_segments(frames, config, "previous")], config)
        golden = load_backend("golden").run(frames, config, reference="previous")
        assert find_mismatch(golden, results) is None
        timelines = predict_timelines(golden, results, config, "previous", lanes=LANES)
        predicted += len(timelines)
        assert find_clock_mismatch(timelines, results) is None, (width_px, height_px, config)
    assert predicted > RUNS // 2
