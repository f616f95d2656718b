# amaranth: UnusedElaboratable=no
"""Blended pixels equal the golden model, with every share."""

import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from golden_model.painting.blending import FADE, blend
from hdl.blocks.export import find_block, write_block
from hdl.painting.blending import Blending
from sim.simulators.recording import NO_PAUSES, Pauses
from tests.hdl.block_bench import BlockBench
from tests.hdl.drivers import run_streams
from tests.hdl.painting.payloads import pixel_payload, pixel_row

COUNT = 600


def pixels(seed: int = 1) -> tuple[NDArray[np.uint8], NDArray[np.int64], NDArray[np.int64]]:
    """Old pixels, colours and weights: extreme and random colours, weights near each other, equal, 0 and 255."""
    rng = np.random.default_rng(seed)
    old = rng.integers(0, 256, (COUNT, 4), dtype=np.uint8)
    colours = rng.integers(0, 256, (COUNT, 3))
    old[::5, :3], colours[::3] = 255 * (rng.random((COUNT // 5, 3)) < 0.5), rng.choice([0, 255], (COUNT // 3, 3))
    weights = np.clip(old[:, 3].astype(int) + rng.integers(-FADE, FADE + 1, COUNT), 0, 255)
    weights[::7], old[::11, 3] = rng.integers(0, 256, len(weights[::7])), 0
    weights[::13], weights[::17], old[::19, 3] = 0, 255, 1
    return old, colours, weights


def payloads(old: NDArray[np.uint8], colours: NDArray[np.int64], weights: NDArray[np.int64]) -> list[dict[str, Any]]:
    rows = zip(old[:, :3], old[:, 3], colours, weights, strict=True)
    return [{"old": pixel_payload(under, before), "new": pixel_payload(over, now)} for under, before, over, now in rows]


@pytest.mark.parametrize("pauses", [NO_PAUSES, Pauses(gaps=90, stalls=150, seed=5)], ids=["free", "pauses"])
def test_blended_pixels_equal_the_golden_model(pauses: Pauses) -> None:
    given = pixels()
    shares = np.clip(given[2].astype(int) - given[0][:, 3] + FADE // 2, 0, FADE)[given[0][:, 3] > 0]
    assert set(shares) == set(range(FADE + 1))
    # Without pauses, a clock until it is ready, one per pixel, the latency, and one in which the bench stops.
    limit = COUNT + Blending.latency_cycles + 2 if pauses == NO_PAUSES else 5 * COUNT
    inputs = {"i": payloads(*given)}
    results = run_streams(Blending(), inputs, {"o": COUNT}, pauses=pauses, cycle_limit=limit)["o"]
    np.testing.assert_array_equal([pixel_row(each) for each in results], blend(*given))


def test_a_reset_leaves_nothing_behind() -> None:
    dut = Blending()
    given = payloads(*pixels(2))
    expected = blend(*pixels(2))
    bench = BlockBench(dut, cycle_limit=400)
    results: list[list[int]] = []

    async def run(ctx: Any) -> None:
        for count in (1, 4, 9):
            for payload in given[:count]:
                await bench.stream_put(ctx, dut.i, payload)
            await bench.pulse(ctx, bench.reset)
            await bench.stream_put(ctx, dut.i, given[20])
            results.append(pixel_row(await bench.stream_get(ctx, dut.o)))

    bench.run(run)
    assert results == [expected[20].tolist()] * 3


OUTSIDE = """
module bench;
  reg clk = 0, rst = 1, valid = 0;
  wire [7:0] blue, green, red, weight;
  wire is_valid;
  always #5 clk = ~clk;
  blending dut(.clk(clk), .rst(rst), .i_valid(valid), .o_ready(1'b1), .o_valid(is_valid), .i_old_colour_0(8'd11),
    .i_old_colour_1(8'd22), .i_old_colour_2(8'd33), .i_old_weight(8'd4), .i_new_colour_0(8'hxx),
    .i_new_colour_1(8'hxx), .i_new_colour_2(8'hxx), .i_new_weight(8'd0), .o_colour_0(blue), .o_colour_1(green),
    .o_colour_2(red), .o_weight(weight));
  initial begin
    repeat (3) @(negedge clk);
    rst = 0;
    valid = 1;
    @(posedge is_valid) #1 $display("%0d %0d %0d %0d", blue, green, red, weight);
    $finish;
  end
endmodule
"""


@pytest.mark.needs("icarus")
def test_what_is_unknown_outside_the_frame_stays_there(tmp_path: Path) -> None:
    """A memory that was never written is X in a simulation of four values."""
    write_block(tmp_path, *find_block("hdl.painting.blending:Blending"))
    (tmp_path / "bench.v").write_text(OUTSIDE)
    subprocess.run(["iverilog", "-g2012", "-o", "bench", "bench.v", "blending.v"], cwd=tmp_path, check=True)
    told = subprocess.run(["vvp", "-n", "bench"], cwd=tmp_path, check=True, capture_output=True, text=True).stdout
    assert told.splitlines()[0] == "11 22 33 4"
