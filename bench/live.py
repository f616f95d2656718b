"""What each build reaches at its clock, and a rendered flight through the live build in simulation.

    python bench/live.py [--clock-mhz 150] [--json FILE]
    python bench/live.py --frames 100 --size 1280x720 [--seed N]

Frame rates are exact: clocks of the golden model's timeline, for 2,000 features, of which 1,400 match. The simulation
runs the whole live build: a camera with its own clock, a memory with random latency and back-pressure, a host that
reads the rings through the exported reader, has homographies scored, some of them out of range, and pauses from time
to time. Every frame that is delivered and every score is compared with the golden model; every other frame has to be
counted as dropped. Latency is from a frame's last pixel at the camera to the end of its matches' header in memory.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import cv2
import numpy as np
import typer
from numpy.typing import NDArray
from rich.console import Console
from rich.progress import track
from rich.table import Table

from golden_model.config import PRESETS
from golden_model.front_end import extract
from golden_model.geometry.scoring import answers, quantise
from golden_model.timing import FrameWork, steady_pace
from hdl.settings import REQUESTED, matched_frame_settings
from sim.backends.golden import add_matches
from sim.backends.interface import BUILT_LANES
from sim.benches.exported import host_programs
from sim.benches.live import CameraTiming, LiveBench, MemoryRules
from sim.scene import make_lawnmower

AERIAL = PRESETS["aerial"]
FEATURES, MATCHES = 2000, 1400
WANTED = {"640x480": 60, "1280x720": 60, "1920x1080": 60, "3840x2160": 30}
"""Frames a second that a camera of this size has."""
SLOTS = 8
PROPOSED = 20
"""Hypotheses a frame; there are three more."""
PAUSE_EVERY, PAUSE_FRAMES = 25, 9
"""The host stops reading for so many frames, from time to time: longer than the ring holds."""


class Rate(NamedTuple):
    """What a build reaches with frames of one size."""

    frame_clocks: int
    frames_a_second: float
    latency_us: float
    wanted: int


def rates(clock_mhz: float) -> dict[str, Rate]:
    """Frames a second and latency for each size."""
    found = {}
    for name, wanted in WANTED.items():
        width, height = map(int, name.split("x"))
        rows = np.linspace(0, FEATURES - 1, MATCHES).astype(int)
        work = FrameWork(width, height, good=True, left=FEATURES, right=FEATURES, rows=rows)
        pace = steady_pace(work, AERIAL, lanes=BUILT_LANES)
        assert pace is not None
        found[name] = Rate(pace[0], 1e6 * clock_mhz / pace[0], pace[1] / clock_mhz, wanted)
    return found


def flight(frames: int, size_px: tuple[int, int], seed: int) -> list[NDArray[np.uint8]]:
    """A rendered flight in gray, its photographs as close as those of a video."""
    images = make_lawnmower(seed, frames, size_px, forward_overlap=0.9).images
    return [cv2.cvtColor(images[n], cv2.COLOR_BGR2GRAY) for n in track(range(frames), "rendering", transient=True)]


def proposals(matches: NDArray[np.void], rng: np.random.Generator) -> NDArray[np.int64]:
    """Hypotheses from random fours of the kept matches, as a host proposes them; the last two are out of range."""
    kept = matches[matches["verdict"] == 1]
    found = [np.eye(3)]
    for _ in range(PROPOSED if len(kept) >= 4 else 0):
        four = rng.choice(kept, 4, replace=False)
        left, right = (np.stack((four[f"{side}_x"], four[f"{side}_y"]), axis=1) / 16 for side in ("left", "right"))
        H = cv2.getPerspectiveTransform(left.astype(np.float32), right.astype(np.float32))
        if np.isfinite(H).all() and H.any():
            found.append(H)
    hypotheses = quantise(np.array([*found, np.eye(3), np.eye(3)]))
    hypotheses[-2] <<= 2
    hypotheses[-1] >>= 2
    return hypotheses


def fly(frames: list[NDArray[np.uint8]], size_px: tuple[int, int], seed: int) -> dict[str, Any]:
    """Send a flight through the live build, and compare what is delivered."""
    front_end = AERIAL.front_end.for_size(*size_px)
    settings = matched_frame_settings(AERIAL, *size_px, gray_input=True)
    # The camera's clock has 99 edges in 100 of the design: 148.5 of 150 MHz, that of 1080p60.
    camera = CameraTiming(line_blank=size_px[0] // 8, frame_blank=20 * size_px[0], jitter=8, steps=99, period=100)
    rules = MemoryRules(waits=40, latency_clocks=120, seed=seed)
    bench = LiveBench(AERIAL, size_px, length_bytes=1 << 22, camera=camera, rules=rules, progress=Console().print)
    with host_programs("live", AERIAL, max_width_px=size_px[0], max_height_px=size_px[1], video_bits=8) as load:
        wanted_settings = {name: settings[name] for name in (*REQUESTED, "gray_input")}
        live = load("skymosaic_live").Live(bench, wanted_settings, slots=SLOTS)
        scorer = load("skymosaic_scores").Scorer(bench)
    bench.show(frames)
    rng = np.random.default_rng(seed)
    delivered, latencies, matches_of, scored = [], [], {}, []
    frame_clocks = round((size_px[0] + camera.line_blank) * (size_px[1] + 20))
    while (frame := live.next_frame(2.5e-7 * frame_clocks)) is not None:
        assert frame.good
        delivered.append((frame.number, frame.features.copy(), frame.matches.copy()))
        latencies.append(frame.time + frame.clocks - bench.last_pixels[frame.number - 1])
        matches_of[int(frame.match_status["frame"])] = frame.matches.copy()
        hypotheses = proposals(matches_of[int(frame.match_status["frame"])], rng)
        live.release()
        scored.append((hypotheses, scorer.score_integers(hypotheses)))
        if len(delivered) % PAUSE_EVERY == 0:
            bench.run(PAUSE_FRAMES * frame_clocks)
    counts = live.counts()
    golden = (
        extract(frames[number - 1], front_end, frame=n)
        for n, (number, *_) in enumerate(track(delivered, "golden model", transient=True))
    )
    equal = [
        np.array_equal(features, wanted.features) and np.array_equal(matches, wanted.matches)
        for (_, features, matches), wanted in zip(
            delivered, add_matches(((g.features, g.status, None) for g in golden), AERIAL, "previous"), strict=True
        )
    ]
    same_scores = [
        np.array_equal(record, answers(hypotheses[n : n + 1], matches_of[int(record["frame"])], record["frame"])[0])
        for hypotheses, records in scored
        for n, record in enumerate(_renumbered(records))
    ]
    numbers = {number for number, *_ in delivered}
    return {
        "size": "x".join(map(str, size_px)),
        "frames in": counts["camera_frames"],
        "delivered": len(delivered),
        "equal to the golden model": sum(equal),
        "reported as dropped": counts["dropped"],
        "really missing": len(set(range(1, len(frames) + 1)) - numbers),
        "features a frame": round(np.mean([len(features) for _, features, _ in delivered])),
        "hypotheses": len(same_scores),
        "of these, answers equal to the golden model": sum(same_scores),
        "hypotheses without a score, as counted": counts["unscored"],
        "hypotheses without a score, as answered": sum(int(np.count_nonzero(each["causes"])) for _, each in scored),
        "latency, clocks (median)": int(np.median(latencies)),
        "latency, clocks (longest)": max(latencies),
        "AXI violations": bench.violations,
        "clocks": bench.cycle,
    }


def _renumbered(records: NDArray[np.void]) -> NDArray[np.void]:
    """Score records as if each had been asked for alone."""
    assert (records["number"] == np.arange(len(records))).all()
    alone = records.copy()
    alone["number"] = 0
    return alone


def main(
    frames: Annotated[int, typer.Option(help="Simulate a flight of so many frames.")] = 0,
    size: Annotated[str, typer.Option(help="Of the frames.")] = "640x480",
    seed: Annotated[int, typer.Option(help="Of flight and memory.")] = 1,
    clock_mhz: Annotated[float, typer.Option(help="Clock of the design.")] = 150,
    json_file: Annotated[Path | None, typer.Option("--json", help="Write the figures here.")] = None,
) -> None:
    """Print the table of rates, or that of a simulated flight."""
    console = Console()
    if frames:
        width_px, height_px = map(int, size.split("x"))
        figures: dict[str, Any] = fly(flight(frames, (width_px, height_px), seed), (width_px, height_px), seed)
        table = Table("simulated flight", "", title=f"{frames} frames through the live build")
        for name, value in figures.items():
            table.add_row(name, str(value))
    else:
        found = rates(clock_mhz)
        figures = {name: rate._asdict() for name, rate in found.items()}
        table = Table(
            "frames", "clocks", "frames/s", "wanted", "last pixel to last match, µs", title=f"{clock_mhz} MHz"
        )
        for name, rate in found.items():
            enough = "yes" if rate.frames_a_second >= rate.wanted else "no"
            cells = f"{rate.frames_a_second:.1f}", f"{rate.wanted}: {enough}", f"{rate.latency_us:.0f}"
            table.add_row(name, str(rate.frame_clocks), *cells)
    console.print(table)
    if json_file:
        json_file.write_text(json.dumps(figures, indent=1) + "\n")


if __name__ == "__main__":
    typer.run(main)
