"""The accelerator: its clocks by the golden models, and in simulation whether it equals them, and how fast that is.

    python -m bench.hardware rates
    python -m bench.hardware equality
    python -m bench.hardware speed

Clocks are those of camera builds. The model is exact for streams without pauses; tests compare it with the simulated
hardware, clock by clock (`tests/golden_model/test_timing.py`), so only `equality` and `speed` simulate.
"""

import dataclasses
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated

import cv2
import numpy as np
import typer

from bench.report import Row, program, public_folder, reported
from golden_model.arrays import Pixels
from golden_model.config import PRESETS
from golden_model.geometry.estimator import MAX_CYCLES
from golden_model.timing import FrameWork, steady_pace
from hdl.build import Build
from sim.scene import make_pair
from sim.simulators import verilator
from sim.simulators.accelerator_designs import design_accelerator
from sim.simulators.hardware import make_segments
from skymosaic.evaluation.hardware import compare
from skymosaic.evaluation.known_pairs import read_pairs
from skymosaic.features.backends import BackendName
from skymosaic.registration.options import WORKING_WIDTH_PX, PhotographOptions

app = program(__doc__)

AERIAL = PRESETS["aerial"]
CLOCK_MHZ = 150
LANES = 16
SIZES_PX = ((640, 480), (1280, 720), (1920, 1080), (3840, 2160))
CAMERA_FEATURES, CAMERA_MATCHES = 2000, 1400
DEMO_SEED = 9
PUBLIC_PAIRS = ("syn180_02_brighton", "real_brighton_14_15", "real_happy_A")
"""A photograph cut twice and turned, two consecutive photographs, and two of another camera."""
COLOUR_PAIR = ("DJI_0018.jpg", "DJI_0019.jpg")
"""Of brighton_beach, at its full width."""
Image = str | Path | Pixels


@app.command()
@reported(f"camera builds, {CAMERA_FEATURES} features of which {CAMERA_MATCHES} match")
def rates() -> Iterator[Row]:
    """What a camera build reaches at its clock, with many features in every frame."""
    for width_px, height_px in SIZES_PX:
        indices = np.linspace(0, CAMERA_FEATURES - 1, CAMERA_MATCHES).astype(int)
        work = FrameWork(width_px, height_px, good=True, left=CAMERA_FEATURES, right=CAMERA_FEATURES, rows=indices)
        pace = steady_pace(work, AERIAL, lanes=LANES)
        longest = steady_pace(dataclasses.replace(work, estimate_cycles=MAX_CYCLES), AERIAL, lanes=LANES)
        assert pace is not None
        assert longest is not None
        yield {
            "frames": f"{width_px}×{height_px}",
            "clocks per frame": pace[0],
            f"frames per second at {CLOCK_MHZ} MHz": round(1e6 * CLOCK_MHZ / pace[0], 1),
            "with homographies, at least": round(1e6 * CLOCK_MHZ / longest[0], 1),
            "last pixel to last match, ms": round(pace[1] / CLOCK_MHZ / 1000, 2),
        }


def compared_pairs() -> dict[str, tuple[Image, Image, int]]:
    """Left and right photograph, and the working width, by name."""
    known = {pair.name: pair for pair in read_pairs(public_folder("registration"))}
    demo = make_pair(seed=DEMO_SEED).images
    left, right = (public_folder("brighton_beach") / name for name in COLOUR_PAIR)
    return {
        "`make demo`": (demo[0], demo[1], WORKING_WIDTH_PX),
        **{name: (known[name].left, known[name].right, WORKING_WIDTH_PX) for name in PUBLIC_PAIRS},
        f"{left.stem} and {right.stem}, in colour": (left, right, 1600),
    }


@app.command()
@reported("hardware and golden model")
def equality(
    address: Annotated[str | None, typer.Option(help="HOST[:PORT] of a board; by default the simulation.")] = None,
) -> Iterator[Row]:
    """Compare every field of every feature, match and status of public pairs and of that of `make demo`."""
    backend: BackendName = "board" if address else "rtl"
    for name, (left, right, width_px) in compared_pairs().items():
        options = PhotographOptions(backend=backend, address=address, working_width_px=width_px)
        result = compare(left, right, options, progress=print)
        yield {
            "pair": name,
            "equal": f"no: {result.mismatch}" if result.mismatch else "yes",
            "features of level 0 + 1": " + ".join(map(str, result.coverage.features)),
            "sectors": result.coverage.sectors,
            "matches": result.coverage.matches,
            "clocks per frame": max(result.cycles_per_frame),
        }


@app.command()
@reported("best of {runs}")
def speed(runs: Annotated[int, typer.Option(min=1, help="Runs; the best counts.")] = 5) -> Iterator[Row]:
    """Simulate a rendered 640x480 pair in the accelerator, features and matches, on one core.

    Counts processor time, which other work on the machine lengthens less than wall time. The build is not timed.
    """
    frames = [cv2.cvtColor(image, cv2.COLOR_BGR2GRAY) for image in make_pair(seed=1).images]
    design, segments = design_accelerator(Build(config=AERIAL)), make_segments(frames, AERIAL, "held")
    verilator.build_library(design, progress=print)
    seconds = []
    for _ in range(runs):
        started = time.process_time()
        recording = verilator.simulate(design, segments)[-1]
        seconds.append(time.process_time() - started)
    cycles = max(int(output.ends[-1, 1]) for output in recording.outputs.values()) - int(recording.starts[0]) + 1
    yield {
        "design": "accelerator, Verilator",
        "clocks of two frames and their matching": cycles,
        "s": f"{min(seconds):.2f}",
        "M cycles/s": f"{cycles / min(seconds) / 1e6:.2f}",
    }


if __name__ == "__main__":
    app()
