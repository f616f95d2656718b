# amaranth: UnusedElaboratable=no
"""What Yosys makes of each block, for xc7 and for the ECP5, equals the golden model.

The blocks are those of `test_export`, for lines of 64 px; those for the ECP5 instantiate its multipliers and block
RAMs, as in `bench.synthesis`.
"""

from collections.abc import Callable
from functools import partial
from pathlib import Path

import pytest

from bench.designs import largest_rules
from golden_model.config import MIN_FRAME_PX, Config, FrontEndConfig
from hdl.accelerator import AcceleratorTop
from hdl.blocks.catalogue import CATALOGUE, make_block
from hdl.blocks.export import module_ports, write_block
from hdl.blocks.flat import FlatBlock
from hdl.blocks.vectors import Block
from hdl.build import Build
from hdl.export.accelerator_bench import make_accelerator_bench
from hdl.lib.ecp5 import Ecp5
from hdl.netlist import to_verilog
from sim.benches.painter import PainterTop
from sim.simulators import verilator
from sim.simulators.design import Design
from tests.hdl.netlists import SYNTHESIS, models, run_bench, run_compiled_bench, synthesise
from tests.hdl.painting import test_painter
from tests.hdl.pixel.test_rows import raw_response

pytestmark = [pytest.mark.needs("icarus"), pytest.mark.needs("compiler")]
COMPILED = ("harris", "corners", "ilbp", "matcher", "homography", "accelerator")
"""Simulated by Verilator: Icarus takes minutes or hours."""
QUICK = "half", "ecp5"
"""The others are slow tests: what any block becomes on xc7 takes Yosys half a minute."""


def listed(name: str) -> Block:
    """A row of the catalogue, for lines of 64 px."""
    return make_block(name, {"width_px": 64} if "width_px" in CATALOGUE[name].settings else {})


def export_accelerator(folder: Path, platform: object) -> None:
    """Write the accelerator at its smallest, and its test bench."""
    front_end = FrontEndConfig(descriptor="thesis-ilbp-1", levels=1, border_px=10, max_features=64)
    config, side_px = Config(front_end=front_end), MIN_FRAME_PX
    build = Build(config=config, lanes=2, video_bits=8, max_width_px=side_px, max_height_px=side_px)
    top = AcceleratorTop(build)
    files = make_accelerator_bench("accelerator", module_ports(top), build).files()
    for name, text in {**files, "accelerator.v": to_verilog(top, name="accelerator", platform=platform)}.items():
        (folder / name).write_text(text)


ROWS: dict[str, Callable[[], Block]] = {
    "raw_response": raw_response,
    # The painter has a test of its own, with more than a bench can do.
    **{name: partial(listed, name) for name in CATALOGUE if name != "painter"},
    "matcher, largest rules": lambda: make_block("matcher", {"rule_base": largest_rules()}),
}


@pytest.mark.parametrize(
    ("title", "family"),
    [
        pytest.param(title, family, marks=[] if (title, family) == QUICK else [pytest.mark.slow])
        for title in (*ROWS, "accelerator")
        for family in SYNTHESIS
    ],
)
def test_the_netlist_of_a_block_equals_the_golden_model(tmp_path: Path, title: str, family: str) -> None:
    """Synthesised and simulated."""
    folder, name = tmp_path, title.partition(",")[0]
    platform = Ecp5() if family == "ecp5" else None
    source = folder / f"{name}.v"
    if name == "accelerator":
        export_accelerator(folder, platform)
    else:
        block = ROWS[title]()
        write_block(folder, name, block)
        if platform:
            source.write_text(to_verilog(FlatBlock(block.component), name=name, platform=platform))
    netlist = synthesise(folder, name, family, source)
    simulate = run_compiled_bench if name in COMPILED else run_bench
    printed = simulate(folder, name, [netlist, *models(folder, family)])
    assert printed.startswith("PASS"), printed


@pytest.mark.slow
@pytest.mark.parametrize("family", SYNTHESIS)
def test_the_netlist_of_the_painter_equals_the_golden_model(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, family: str
) -> None:
    """With a memory that waits and fails, and poses of all kinds, as the painter itself is tested."""
    source = tmp_path / "top.v"
    source.write_text(to_verilog(PainterTop(), platform=Ecp5() if family == "ecp5" else None))
    netlist = synthesise(tmp_path, "top", family, source)
    verilog = "\n".join(path.read_text() for path in (netlist, *models(tmp_path, family)))
    flags = (*verilator.VERILATOR_FLAGS, "--top-module", "top", "-DNO_INCLUDES")
    monkeypatch.setattr(Design, "verilog", lambda *_, **__: verilog)
    monkeypatch.setattr(verilator, "VERILATOR_FLAGS", flags)
    test_painter.test_every_byte_is_the_models(replaces=False, count=30)
    test_painter.test_every_byte_is_the_models(replaces=True, count=20)
    test_painter.test_poses_are_composed_and_refused()
    test_painter.test_a_memory_that_fails_spoils_no_pixel(wide=True)
