"""Speed of the simulators: front end and whole accelerator, a rendered 640x480 pair, one core.

    python bench/simulation.py [NAME...] [--runs N] [--cached] [--json FILE]

NAMEs choose among verilator and pysim. Build times are those of an empty cache, Amaranth's elaboration
included; with --cached the user's cache serves, and no build is timed. Runs count processor time, which other work on
the machine lengthens less than wall time, and the best of them; on an idle machine both are the same. The latency
counts from a frame's last pixel to its last word of features.
"""

from __future__ import annotations

import json
import os
import tempfile
import time
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Annotated, Any

import cv2
import numpy as np
import typer
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from golden_model.config import PRESETS
from hdl.settings import frame_settings
from sim.scene import make_pair
from sim.simulators import accelerator_designs, pysim, verilator
from sim.simulators.design import Design
from sim.simulators.hardware import make_segments
from sim.simulators.recording import Recording, Segment, flatten_frame

SIMULATORS = {"verilator": verilator, "pysim": pysim}
AERIAL = PRESETS["aerial"]
TINY_PX = 64
"""Side of the frame for Amaranth's simulator, which would take minutes for a whole one."""


def gray_pair() -> list[NDArray[np.uint8]]:
    """The two pictures."""
    return [cv2.cvtColor(image, cv2.COLOR_BGR2GRAY) for image in make_pair(seed=1).images]


def front_end_segment(frames: list[NDArray[np.uint8]]) -> Segment:
    """Frames for the front end alone."""
    height_px, width_px = frames[0].shape
    data, flags = (np.concatenate(parts) for parts in zip(*map(flatten_frame, frames), strict=True))
    values = frame_settings(AERIAL.front_end, width_px, height_px, gray_input=True)
    return Segment(data, flags, packets=len(frames), cycle_limit=4 * data.size, settings=values)


def workloads(simulator: str) -> dict[str, tuple[Design, list[Segment]]]:
    """Designs and what is streamed through them."""
    frames = gray_pair()
    if simulator == "pysim":
        frames = [frame[:TINY_PX, :TINY_PX] for frame in frames]
    front_end = (
        accelerator_designs.design_front_end(AERIAL.front_end, accelerator_designs.BUILT_SIZES_PX[0]),
        [front_end_segment(frames)],
    )
    if simulator == "pysim":
        return {"front end": front_end}
    accelerator = (
        accelerator_designs.design_accelerator(AERIAL, accelerator_designs.BUILT_SIZES_PX[0]),
        make_segments(frames, AERIAL, "held"),
    )
    return {"front end": front_end, "accelerator": accelerator}


def timed(call: Callable[[], list[Recording]], runs: int) -> tuple[float, Recording]:
    """Processor seconds of the fastest run, and the last segment it recorded."""
    seconds = []
    for _ in range(runs):
        started = time.process_time()
        recordings = call()
        seconds.append(time.process_time() - started)
    return min(seconds), recordings[-1]


def compiled_row(simulator: str, design: Design, segments: list[Segment], *, runs: int, cached: bool) -> dict[str, Any]:
    """A compiled simulator: build, then the best run, the start of the simulation included."""
    started = time.perf_counter()
    verilator.build_library(design)
    build_seconds = None if cached else round(time.perf_counter() - started, 1)
    seconds, recording = timed(lambda: verilator.simulate(design, segments), runs)
    return {"cold build s": build_seconds, **row(recording, seconds, seconds)}


def pysim_row(design: Design, segments: list[Segment]) -> dict[str, Any]:
    """Amaranth's simulator elaborates in each run: its speed is that of the frames that a longer run adds."""
    short, _ = timed(lambda: pysim.simulate(design, segments), 1)
    long, recording = timed(lambda: pysim.simulate(design, segments * 3), 1)
    return {"cold build s": None, **row(recording, short, (long - short) / 2)}


def row(recording: Recording, run_seconds: float, seconds: float) -> dict[str, Any]:
    """Figures of a segment with two frames that took ``seconds`` to simulate."""
    features = recording.outputs[accelerator_designs.FEATURES].ends[:, 1]
    starts = recording.starts
    frame_cycles = int(starts[1] - starts[0])
    cycles = max(int(output.ends[-1, 1]) for output in recording.outputs.values()) - int(starts[0]) + 1
    return {
        "run s": round(run_seconds, 3),
        "M cycles/s": round(cycles / seconds / 1e6, 4),
        "cycles a frame": frame_cycles,
        "latency cycles": int(features[-1] - starts[-1]) + 1 - frame_cycles,
    }


def main(
    names: Annotated[list[str] | None, typer.Argument(help="Simulators; all by default.", metavar="[NAME]...")] = None,
    runs: Annotated[int, typer.Option(min=1, help="Runs of each; the best counts.")] = 5,
    cached: Annotated[bool, typer.Option("--cached", help="Use the user's cache; no build is timed.")] = False,
    json_file: Annotated[Path | None, typer.Option("--json", help="Write the figures here.")] = None,
) -> None:
    """Print a row for each simulator and design."""
    figures: dict[str, dict[str, Any]] = {}
    console = Console()
    with ExitStack() as stack:
        if not cached:
            os.environ["XDG_CACHE_HOME"] = stack.enter_context(tempfile.TemporaryDirectory())
        for simulator in names or SIMULATORS:
            for name, (design, segments) in workloads(simulator).items():
                with console.status(f"{name}, {simulator}"):
                    figures[f"{name}, {simulator}"] = (
                        pysim_row(design, segments)
                        if simulator == "pysim"
                        else compiled_row(simulator, design, segments, runs=runs, cached=cached)
                    )
    table = Table("design, simulator", *next(iter(figures.values())), title=f"best of {runs}")
    for name, row in figures.items():
        table.add_row(name, *("" if value is None else str(value) for value in row.values()))
    console.print(table)
    if json_file:
        json_file.write_text(json.dumps(figures, indent=1) + "\n")


if __name__ == "__main__":
    typer.run(main)
