"""Milliseconds of each stage, and files to homography beside OpenCV's SIFT and ORB with MAGSAC, on one core.

    python bench/speed.py [LEFT RIGHT] [--runs N] [--json FILE]

Without files a rendered 640x480 pair is used. The methods take turns, so that a machine whose speed drifts
slows all of them alike; quote the ratios.
"""

from __future__ import annotations

import json
import os
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Annotated

import cv2
import numpy as np
import typer
from rich.console import Console
from rich.table import Table

from baselines import Baseline
from sim.scene import make_pair
from skymosaic import register
from skymosaic.imagery.images import save

WARM_UPS = 2
FEATURES = 1000


def use_one_core() -> None:
    """Pin the process to one core: OpenCV, BLAS and NumPy alike."""
    os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    cv2.setNumThreads(1)


def take_turns(calls: dict[str, Callable[[], object]], runs: int) -> dict[str, list[float]]:
    """Seconds of each call in each round, after warm-up rounds that do not count."""
    seconds: dict[str, list[float]] = {name: [] for name in calls}
    for round_index in range(WARM_UPS + runs):
        for name, call in calls.items():
            start = time.perf_counter()
            call()
            if round_index >= WARM_UPS:
                seconds[name].append(time.perf_counter() - start)
    return seconds


def opencv(name: str, left: str, right: str) -> Callable[[], object]:
    """Files to homography by an OpenCV method."""
    method = Baseline(name, FEATURES)
    return lambda: method.homography(*(cv2.imread(path, cv2.IMREAD_GRAYSCALE) for path in (left, right)))


def stages(left: str, right: str, runs: int) -> dict[str, float]:
    """Median seconds of each stage of our own registration."""
    laps = [register(left, right).seconds for _ in range(WARM_UPS + runs)][WARM_UPS:]
    return {stage: float(np.median([lap[stage] for lap in laps])) for stage in laps[0]}


def main(
    photographs: Annotated[list[Path] | None, typer.Argument(help="LEFT RIGHT", metavar="[LEFT RIGHT]")] = None,
    runs: Annotated[int, typer.Option(min=1, help="Counted rounds.")] = 15,
    json_file: Annotated[Path | None, typer.Option("--json", help="Write the figures here.")] = None,
) -> None:
    """Print stage times and the ratios to OpenCV's methods."""
    use_one_core()
    with tempfile.TemporaryDirectory() as folder:
        if photographs:
            left, right = map(str, photographs)
        else:
            left, right = (f"{folder}/{side}.png" for side in ("left", "right"))
            for path, image in zip((left, right), make_pair(seed=1).images, strict=True):
                save(Path(path), image)
        calls = {"skymosaic aerial": lambda: register(left, right)}
        calls |= {f"{name} {FEATURES} + MAGSAC": opencv(name, left, right) for name in ("sift", "orb")}
        seconds = take_turns(calls, runs)
        laps = stages(left, right, runs)
    medians = {name: float(np.median(values)) for name, values in seconds.items()}
    ours = np.array(seconds["skymosaic aerial"])
    ratios = {name: float(np.median(ours / np.array(values))) for name, values in seconds.items()}

    console = Console()
    stage_table = Table("stage", "ms", title="skymosaic aerial, stage by stage (median)")
    for stage, value in laps.items():
        stage_table.add_row(stage, f"{1000 * value:.1f}")
    console.print(stage_table)
    method_table = Table("files to homography", "ms", "skymosaic / this", title=f"one core, {runs} rounds (medians)")
    for name, value in medians.items():
        method_table.add_row(name, f"{1000 * value:.1f}", f"{ratios[name]:.2f}")
    console.print(method_table)
    if json_file:
        figures = {"stages_s": laps, "methods_s": medians, "ratios": ratios}
        json_file.write_text(json.dumps(figures, indent=1) + "\n")


if __name__ == "__main__":
    typer.run(main)
