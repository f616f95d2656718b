"""Hypotheses a second of the scoring block: clocks as predicted, and as simulated for a few hypotheses.

    python bench/scoring.py [--hypotheses 500] [--json FILE]

The simulation must give the predicted clock of every score, and the golden model's scores.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from rich.console import Console
from rich.table import Table

from golden_model.geometry.scoring import finish_cycles, quantise, score
from hdl.geometry.scoring import HomographyScoring
from sim.benches.block_bench import BlockBench
from sim.benches.scoring import set_of_matches, time_scores

MATCHES = (10, 100, 500, 1000, 1850, 2048)
"""The last but one is the most that a 640x480 frame can have, the last what the memory holds."""
SIMULATED = 3
"""Hypotheses that are simulated: one alone, and two that overlap."""
CLOCK_HZ = 150e6


def simulate(count: int) -> None:
    """Compare clocks and scores of some hypotheses with what is predicted."""
    rng = np.random.default_rng(count)
    left = rng.integers(0, 640 * 16, (count, 2))
    right, weight = np.abs(left + rng.integers(-64, 65, left.shape)), rng.integers(0, 256, count)
    spread = np.array([[1e-3, 1e-3, 1], [1e-3, 1e-3, 1], [1e-7, 1e-7, 0]])
    hypotheses = quantise(np.eye(3) + rng.normal(size=(SIMULATED, 3, 3)) * spread)
    found: list[tuple[int, Any]] = []
    dut = HomographyScoring()

    async def run(ctx: Any) -> None:
        for payload in set_of_matches(left, right, weight):
            await bench.stream_put(ctx, dut.i_matches, payload)
        found.extend(await time_scores(ctx, dut, hypotheses))

    bench = BlockBench(dut, cycle_limit=10 * (count + 100))
    bench.run(run)
    assert [clock for clock, _ in found] == finish_cycles(count, SIMULATED).tolist(), f"{count} matches: other clocks"
    golden = score(hypotheses, left, right, weight)
    assert [each.score for _, each in found] == golden.score.tolist(), f"{count} matches: other scores"


def row(count: int, hypotheses: int) -> dict[str, Any]:
    """What a set of ``count`` matches takes."""
    simulate(count)
    cycles = finish_cycles(count, hypotheses)
    return {
        "matches": count,
        "clocks of the first": int(cycles[0]),
        f"clocks of {hypotheses}": int(cycles[-1]),
        "ms at 150 MHz": round(1000 * int(cycles[-1]) / CLOCK_HZ, 2),
        "hypotheses a second": int(hypotheses * CLOCK_HZ / cycles[-1]),
    }


def main(
    hypotheses: Annotated[int, typer.Option(min=1, help="How many are scored.")] = 500,
    json_file: Annotated[Path | None, typer.Option("--json", help="Write the figures here.")] = None,
) -> None:
    """Print a row for each number of matches."""
    rows = [row(count, hypotheses) for count in MATCHES]
    table = Table(*rows[0], title="homography scoring")
    for each in rows:
        table.add_row(*map(str, each.values()))
    Console().print(table)
    if json_file:
        json_file.write_text(json.dumps(rows, indent=1) + "\n")


if __name__ == "__main__":
    typer.run(main)
