"""Whether the simulated hardware equals the golden model on real photographs, and how fast it is simulated.

python -m bench.simulation equality
python -m bench.simulation speed
"""

import time
from pathlib import Path
from typing import Annotated

import cv2
import typer

from bench.report import JsonFile, Row, program, public_folder, report
from golden_model.arrays import Pixels
from golden_model.config import PRESETS
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
DEMO_SEED = 9
PUBLIC_PAIRS = ("syn180_02_brighton", "real_brighton_14_15", "real_happy_A")
"""A photograph cut twice and turned, two consecutive photographs, and two of another camera."""
COLOUR_PAIR = ("DJI_0018.jpg", "DJI_0019.jpg")
"""Of brighton_beach, at its full width."""
Image = str | Path | Pixels


def pairs() -> dict[str, tuple[Image, Image, int]]:
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
def equality(
    address: Annotated[str | None, typer.Option(help="HOST[:PORT] of a board; by default the simulation.")] = None,
    json_file: JsonFile = None,
) -> None:
    """Compare every field of every feature, match and status of public pairs and of that of `make demo`."""
    backend: BackendName = "board" if address else "rtl"
    rows: list[Row] = []
    for name, (left, right, width_px) in pairs().items():
        options = PhotographOptions(backend=backend, address=address, working_width_px=width_px)
        result = compare(left, right, options, progress=print)
        rows.append(
            {
                "pair": name,
                "equal": f"no: {result.mismatch}" if result.mismatch else "yes",
                "features of level 0 + 1": " + ".join(map(str, result.coverage.features)),
                "sectors": result.coverage.sectors,
                "matches": result.coverage.matches,
                "clocks per frame": max(result.cycles_per_frame),
            }
        )
    report(f"{backend} and golden model", rows, json_file)


@app.command()
def speed(
    runs: Annotated[int, typer.Option(min=1, help="Runs; the best counts.")] = 5, json_file: JsonFile = None
) -> None:
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
    row: Row = {
        "design": "accelerator, Verilator",
        "clocks of two frames and their matching": cycles,
        "s": f"{min(seconds):.2f}",
        "M cycles/s": f"{cycles / min(seconds) / 1e6:.2f}",
    }
    report(f"best of {runs}", [row], json_file)


if __name__ == "__main__":
    app()
