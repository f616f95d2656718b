"""A rendered flight through the whole camera build with its estimator, in simulation.

    python -m bench.camera [--frames 100] [--size 1280x720] [--seed N]

A camera with its own clock, a memory with random latency and back-pressure, a host that reads the rings through the
exported reader and pauses from time to time. Every frame that is delivered, its homography included, is compared with
the golden model; every other frame has to be counted as dropped. Latency is from a frame's last pixel at the camera to
the end of a header in memory.
"""

import dataclasses
from typing import Annotated, Any

import cv2
import numpy as np
import typer
from rich.console import Console
from rich.progress import track

from bench.report import JsonFile, Row, report
from golden_model.arrays import Pixels, Records
from golden_model.config import PRESETS, EstimatorConfig
from golden_model.front_end import extract
from golden_model.geometry.estimator import MAX_CYCLES
from golden_model.timing import FrameWork, steady_pace
from hdl.build import BUILDS, Build
from hdl.settings import REQUESTED, matched_frame_settings
from sim.backends.golden import add_matches
from sim.benches.camera import CameraBench, CameraTiming
from sim.benches.exported import host_programs
from sim.benches.memory import MemoryRules
from sim.scene import make_lawnmower

CONFIG = dataclasses.replace(PRESETS["aerial"], estimator=EstimatorConfig())
SLOTS = 8
PAUSE_EVERY, PAUSE_FRAMES = 25, 9
"""After each `PAUSE_EVERY` frames the host stops reading for `PAUSE_FRAMES`, more than the ring holds."""
FRAME_BLANK_LINES = 20
WAIT_S_PER_CLOCK = 1e-7
"""A wait of the reader, 2 ms, lets the simulation run for 20,000 clocks."""


def main(
    frames: Annotated[int, typer.Option(min=2, help="Length of the flight.")] = 100,
    size: Annotated[str, typer.Option(help="Of the frames.")] = "1280x720",
    seed: Annotated[int, typer.Option(help="Of flight and memory.")] = 1,
    json_file: JsonFile = None,
) -> None:
    """Print what became of the frames."""
    width_px, height_px = map(int, size.split("x"))
    images = make_lawnmower(seed, frames, (width_px, height_px), forward_overlap=0.9).images
    flight = [cv2.cvtColor(images[n], cv2.COLOR_BGR2GRAY) for n in track(range(frames), "rendering", transient=True)]
    figures = fly(flight, (width_px, height_px), seed)
    heading = f"{frames} frames of {width_px}×{height_px}"
    rows: list[Row] = [{heading: name, "measured": figures[name]} for name in figures]
    report("camera build", rows, json_file)


def fly(frames: list[Pixels], size_px: tuple[int, int], seed: int) -> dict[str, int]:
    """Send a flight through the camera build, and compare what is delivered."""
    width_px, height_px = size_px
    settings = matched_frame_settings(CONFIG, *size_px, gray_input=True)
    build = dataclasses.replace(
        BUILDS["camera"], config=CONFIG, max_width_px=width_px, max_height_px=height_px, video_bits=8
    )
    # Small frames come less often: each is matched, and its homography estimated, before the next one is.
    frame_blank = max(FRAME_BLANK_LINES * width_px, slowest_pace(size_px, build) - width_px * height_px)
    # The camera's clock has 99 edges per 100 of the design: 148.5 of 150 MHz, that of 1080p60.
    camera = CameraTiming(line_blank=width_px // 8, frame_blank=frame_blank, jitter=8, steps=99, period=100)
    rules = MemoryRules(waits=40, latency_clocks=120, seed=seed)
    bench = CameraBench(build, length_bytes=1 << 22, camera=camera, rules=rules, progress=Console().print)
    with host_programs(build) as load:
        requested = {name: settings[name] for name in (*REQUESTED, "gray_input")}
        rings = load("skymosaic_rings").RingReader(bench, requested, slots=SLOTS)
    bench.show(*frames)
    frame_clocks = (width_px + camera.line_blank) * height_px + frame_blank
    # Until the slowest homography is there, in the time of the bench's `wait`.
    patience_s = WAIT_S_PER_CLOCK * (2.5 * frame_clocks + MAX_CYCLES)
    delivered: list[Any] = []
    latencies = []
    while (frame := rings.next_frame(patience_s)) is not None:
        assert frame.good
        delivered.append((frame.number, frame.features.copy(), frame.matches.copy(), frame.homography.copy()))
        waited = frame.time - bench.last_pixels[frame.number - 1]
        latencies.append((waited + frame.clocks, waited + frame.homography_clocks))
        rings.release()
        if len(delivered) % PAUSE_EVERY == 0:
            bench.run(PAUSE_FRAMES * frame_clocks)
    counts = rings.counts()
    to_matches, to_homography = np.array(latencies).T
    return {
        "frames sent": counts["camera_frames"],
        "delivered": len(delivered),
        "of these, equal to the golden model in every record": count_equal(frames, delivered),
        "reported as dropped": counts["dropped"],
        "really missing": len(frames) - len({number for number, *_ in delivered}),
        "features per frame": round(np.mean([len(features) for _, features, *_ in delivered])),
        "the chip's homographies, accepted": sum(int(homography["causes"] == 0) for *_, homography in delivered),
        "the chip's homographies, lost": rings.registers.read("lost_homographies"),
        "last pixel to last match in memory, clocks (median)": int(np.median(to_matches)),
        "last pixel to last match in memory, clocks (longest)": int(to_matches.max()),
        "last pixel to homography in memory, clocks (median)": int(np.median(to_homography)),
        "last pixel to homography in memory, clocks (longest)": int(to_homography.max()),
        "AXI rules broken": bench.violations,
        "clocks simulated": bench.cycle,
    }


def slowest_pace(size_px: tuple[int, int], build: Build) -> int:
    """Clocks from one frame to the next if all features match and every homography takes its longest."""
    most = CONFIG.front_end.max_features
    work = FrameWork(*size_px, good=True, left=most, right=most, rows=np.arange(most), estimate_cycles=MAX_CYCLES)
    pace = steady_pace(work, CONFIG, lanes=build.lanes)
    assert pace is not None
    return pace[0]


def count_equal(frames: list[Pixels], delivered: list[tuple[int, Records, Records, np.void]]) -> int:
    """How many frames have the golden model's features, matches and homography."""
    front_end = CONFIG.front_end.for_size(*frames[0].shape[::-1])
    golden = (extract(frames[number - 1], front_end, frame=n) for n, (number, *_) in enumerate(delivered))
    expected = add_matches(golden, CONFIG, "previous")
    return sum(
        np.array_equal(features, one.features)
        and np.array_equal(matches, one.matches)
        and bool(homography == one.homography)
        for (_, features, matches, homography), one in zip(delivered, expected, strict=True)
    )


if __name__ == "__main__":
    typer.run(main)
