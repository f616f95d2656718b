# amaranth: UnusedElaboratable=no
"""Blocks with the ECP5's own multipliers and block RAMs, simulated with models of them against the golden model."""

import re
from collections import Counter
from pathlib import Path

import pytest
from amaranth.back import rtlil
from amaranth.hdl import Module, Signal

from hdl.blocks.catalogue import make_block
from hdl.blocks.export import write_block
from hdl.blocks.flat import FlatBlock
from hdl.lib.ecp5 import Ecp5
from hdl.lib.line_memory import LineMemory
from hdl.netlist import to_verilog
from hdl.painting.painter import Painter
from tests.hdl.lib.test_lib import wide_product
from tests.hdl.netlists import models, run_bench
from tests.hdl.pixel.test_rows import raw_response


@pytest.mark.needs("icarus")
@pytest.mark.parametrize(
    ("name", "width_px", "cells"),
    [
        ("half", 1920, ["DP16KD"]),
        ("nms", 1920, ["DP16KD"] * 10),
        pytest.param("nms", 4096, ["DP16KD"] * 23, marks=pytest.mark.slow),
        ("raw_response", 1920, ["MULT18X18D"] * 3),
        ("wide_product", 1920, ["MULT18X18D"] * 2),
        # Lines of gray, smoothed gray and gradients; products of five lines, and three of the response.
        pytest.param("harris", 1920, ["DP16KD"] * 14 + ["MULT18X18D"] * (15 + 3), marks=pytest.mark.slow),
    ],
)
def test_a_block_of_instances_equals_the_golden_model(
    tmp_path: Path, name: str, width_px: int, cells: list[str]
) -> None:
    others = {"raw_response": raw_response, "wide_product": wide_product}
    block = others[name]() if name in others else make_block(name, {"width_px": width_px})
    write_block(tmp_path, name, block)
    netlist = to_verilog(FlatBlock(block.component), name=name, platform=Ecp5())
    assert sorted(re.findall(r"^  (DP16KD|MULT18X18D) ", netlist, re.MULTILINE)) == cells
    (tmp_path / f"{name}.v").write_text(netlist)
    printed = run_bench(tmp_path, name, [tmp_path / f"{name}.v", *models(tmp_path, "ecp5")])
    assert printed.startswith("PASS"), printed


def test_the_whole_painter_is_made_of_the_cells() -> None:
    """Wherever it multiplies, the factors fit."""
    cells = Counter(re.findall(r"cell \\(DP16KD|MULT18X18D) ", rtlil.convert(Painter(), platform=Ecp5())))
    # Multipliers: interpolation, blending, the frame's edges, rows of a window and of the canvas, its pages. Memories:
    # windows, weights of tiles, poses.
    assert cells == {"MULT18X18D": 9 + 3 + 2 + 2 + 1, "DP16KD": 24 + 9 + 3}


def test_what_does_not_fit_is_refused_and_what_just_fits_is_not() -> None:
    wide, narrow, bit, m = Signal(19), Signal(4), Signal(), Module()
    Ecp5().multiplier(m, a=wide[1:], b=narrow, loads=(bit, bit, bit), product=Signal(22))
    Ecp5().memory(m, LineMemory(shape=8, depth=16384), load=bit)
    with pytest.raises(ValueError, match="a factor has 19 bits"):
        Ecp5().multiplier(m, a=wide, b=narrow, loads=(bit, bit, bit), product=Signal(23))
    with pytest.raises(ValueError, match="the memory has 16385 words"):
        Ecp5().memory(m, LineMemory(shape=8, depth=16385), load=bit)
