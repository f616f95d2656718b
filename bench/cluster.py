"""Flights beyond one machine: what the starting process of a Dask cluster does, and how the memory of a run grows.

    python -m bench.cluster FLIGHT

FLIGHT is laid out by two threads and by workers of this machine, then rendered flights of two sizes by threads. Every
mosaic is a run of the command line with an empty cache. Processor time and memory are those of the starting process,
without start-up. Bytes are those that the scheduler receives and sends: what workers and starting process send each
other passes it, so each byte counts twice.
"""

import contextlib
import hashlib
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import distributed
import typer
from tornado.iostream import IOStream

from bench.mosaic_quality import wait_for
from bench.pair_sets import public_folder
from bench.rendered_flights import Case, write_images
from bench.report import JsonFile, Row, report
from skymosaic.imagery.photographs import list_sources

START_UP = "import distributed, skymosaic.cli.mosaic"
WORKERS = 0, 1, 2, 4
RENDERED = 1000, 3000
DECODED_MB = 64
"""Decoded photographs have a limit of their own, 1 GB by default, that would hide how the rest grows."""
moved = Counter[str]()


def main(flight: str, json_file: JsonFile = None) -> None:
    """Print a row for each run, and how much memory each further photograph takes."""
    photographs = [source.name for source in list_sources([public_folder(flight)])]
    rows = [measure(f"{len(photographs)} of {Path(flight).name}", photographs, workers) for workers in WORKERS]
    for number in RENDERED:
        with tempfile.TemporaryDirectory() as folder:
            names = write_images(Path(folder), Case(number, 640, 0.6).render(3).images)
            rows.append(measure(f"{number:,} of 640×480", [f"{folder}/{name}" for name in names], 0))
    growth_mb = (float(rows[-1]["peak, MB"]) - float(rows[-2]["peak, MB"])) / (RENDERED[1] - RENDERED[0])
    rows.append({**dict.fromkeys(rows[0], ""), "photographs": "each further one", "peak, MB": f"{growth_mb:.2f}"})
    report("beyond one machine", rows, json_file)


def measure(name: str, photographs: Sequence[str], workers: int) -> Row:
    """The row of one mosaic; the scheduler, if there are workers, is in this process."""
    with tempfile.TemporaryDirectory() as folder, contextlib.ExitStack() as stack:
        output = Path(folder, "mosaic.tif")
        options: tuple[object, ...] = ("-o", output, "--cache", Path(folder, "cache"), "--memory", DECODED_MB)
        if workers:
            start: Any = distributed.LocalCluster
            cluster = start(n_workers=workers, threads_per_worker=1, host="127.0.0.1", dashboard_address=None)
            options += ("--scheduler", stack.enter_context(cluster).scheduler_address)
        start_up_seconds, _ = wait_for("-c", START_UP)
        moved.clear()
        started = time.perf_counter()
        cpu_seconds, peak_mb = wait_for("-m", "skymosaic", "mosaic", *photographs, *map(str, options))
        return {
            "photographs": name,
            "workers": workers or "two threads",
            "mosaic's SHA-256": hashlib.sha256(output.read_bytes()).hexdigest()[:12],
            "wall time, s per photograph": f"{(time.perf_counter() - started) / len(photographs):.2f}",
            "CPU s per photograph": f"{(cpu_seconds - start_up_seconds) / len(photographs):.3f}",
            "through the scheduler, MB per photograph": f"{moved['bytes'] / len(photographs) / 1e6:.2f}",
            "peak, MB": round(peak_mb),
        }


def count_bytes(method: Callable[[Any, Any], int | None]) -> Callable[[Any, Any], int | None]:
    """Count what a method of this process's streams reads or writes."""

    def counted(stream: Any, data: Any) -> int | None:
        count = method(stream, data)
        moved["bytes"] += count or 0
        return count

    return counted


if __name__ == "__main__":
    streams: Any = IOStream
    streams.read_from_fd, streams.write_to_fd = map(count_bytes, (IOStream.read_from_fd, IOStream.write_to_fd))
    typer.run(main)
