# amaranth: UnusedElaboratable=no
"""Blending, positions and tiles answer as the golden model."""

import subprocess
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from golden_model.painting.blending import FADE, blend
from golden_model.painting.corners import CORNER
from golden_model.painting.positions import positions
from hdl.blocks.export import find_block, write_block
from hdl.blocks.vectors import Block, of_stream
from hdl.painting.blending import Blending
from hdl.painting.positions import Positions
from tests.golden_model.painting import tilted
from tests.hdl.painting.payloads import corner_payload, pixel_payload
from tests.hdl.rows import row_test

COUNT = 600


def pixels() -> tuple[NDArray[np.uint8], NDArray[np.int64], NDArray[np.int64]]:
    """Old pixels, colours and weights: extreme and random colours, weights near each other, equal, 0 and 255."""
    rng = np.random.default_rng(1)
    old = rng.integers(0, 256, (COUNT, 4), dtype=np.uint8)
    colours = rng.integers(0, 256, (COUNT, 3))
    old[::5, :3], colours[::3] = 255 * (rng.random((COUNT // 5, 3)) < 0.5), rng.choice([0, 255], (COUNT // 3, 3))
    weights = np.clip(old[:, 3].astype(int) + rng.integers(-FADE, FADE + 1, COUNT), 0, 255)
    weights[::7], old[::11, 3] = rng.integers(0, 256, len(weights[::7])), 0
    weights[::13], weights[::17], old[::19, 3] = 0, 255, 1
    return old, colours, weights


def blending() -> Block:
    old, colours, weights = pixels()
    shares = np.clip(weights - old[:, 3] + FADE // 2, 0, FADE)[old[:, 3] > 0]
    assert set(shares) == set(range(FADE + 1))
    each = zip(old, colours, weights, strict=True)
    sent = [{"old": pixel_payload(under[:3], under[3]), "new": pixel_payload(over, now)} for under, over, now in each]
    answers = [pixel_payload(pixel[:3], pixel[3]) for pixel in blend(old, colours, weights)]
    return replace(of_stream(Blending(), "", sent, answers), clocks_each=1)


def places() -> Block:
    """Level and tilted tiles, half outside the frame, and corners as far apart as a window allows."""
    rng = np.random.default_rng(1)
    corners = np.concatenate([
        tilted.corners(tilted.pose((640, 480), zoom=0.5, turn=2.0, tilt=8e-4), np.array([[0, 0]])),
        tilted.corners(tilted.pose((100, 90), zoom=1.3, turn=0.7), np.array([[7, 3]])),
        # Whatever the corners, the adders follow: beyond the borders of the largest frame.
        *(rng.integers(0, 127 * CORNER.one, (1, 3, 3, 2)) + first * CORNER.one for first in (-60, 4090)),
    ])  # fmt: skip
    flags = [{"window": n % 2, "wide": n // 2 % 2, "blank": n // 3} for n in range(len(corners))]
    sent = [{"corners": corner_payload(each), **of_tile} for each, of_tile in zip(corners, flags, strict=True)]
    found = positions(corners).reshape(len(corners), -1, 2).tolist()
    answers: list[dict[str, Any]] = [
        {"x": x, "y": y, **of_tile} for of_tile, tile in zip(flags, found, strict=True) for x, y in tile
    ]
    return of_stream(Positions(), "", sent, answers)


test_rows = row_test({"blending": blending, "positions": places})


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
