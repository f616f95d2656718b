"""The recorded areas and logic levels of the blocks are those of the sources."""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from bench import synthesis

RECORDED = synthesis.recorded_rows()
LARGEST_FIRST = sorted(RECORDED, key=lambda name: RECORDED[name]["LUT"], reverse=True)
QUICK = "sobel"


def check(*names: str) -> subprocess.CompletedProcess[str]:
    """Synthesise designs and compare them with the recorded figures."""
    command = [sys.executable, "-m", "bench.synthesis", "area", *names, "--check"]
    return subprocess.run(command, capture_output=True, text=True, check=False, cwd=Path(__file__).parents[2])


def test_a_quick_block_has_its_recorded_area() -> None:
    done = check(QUICK)
    assert done.returncode == 0, done.stderr


@pytest.mark.slow
@pytest.mark.parametrize("name", LARGEST_FIRST)
def test_every_recorded_design_has_its_area(name: str) -> None:
    done = check(name)
    assert done.returncode == 0, done.stderr


def test_a_whole_name_chooses_one_design_and_a_part_all_with_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(synthesis, "designs", lambda: dict.fromkeys(("gray", "gray, wide", "sobel")))

    def chosen(*names: str) -> list[object]:
        return [row["design"] for row in synthesis.run_designs(list(names), lambda *_: {})]

    assert chosen("gray") == ["gray"]
    assert chosen("gra") == ["gray", "gray, wide"]
    assert chosen("sobel", "wide") == ["gray, wide", "sobel"]


def test_a_changed_and_an_unrecorded_figure_are_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    gray: dict[str, Any] = dict(RECORDED["gray"])
    recorded = tmp_path / "synthesis.json"
    recorded.write_text(json.dumps({"rows": [{**gray, "FF": gray["FF"] + 1}]}))
    monkeypatch.setattr(synthesis, "RECORDED", recorded)
    changed, unknown = synthesis.differences([gray, RECORDED["sobel"]])
    assert changed == f"gray: FF {gray['FF'] + 1} -> {gray['FF']}"
    assert unknown.startswith("sobel: LUT not recorded -> ")
    synthesis.record([gray])
    assert synthesis.differences([gray]) == []


def cell(kind: str, inputs: dict[str, int], outputs: dict[str, int]) -> dict[str, object]:
    """A cell of a netlist: its pins, and the nets at them."""
    directions = dict.fromkeys(inputs, "input") | dict.fromkeys(outputs, "output")
    connections = {pin: [net, "0"] for pin, net in (inputs | outputs).items()}
    return {"type": kind, "port_directions": directions, "connections": connections}


def test_levels_are_counted_between_registers() -> None:
    # Register, look-up table, carry, read address of a LUT RAM, register. Another path ends at the RAM's data input.
    cells = {
        "source": cell("FDRE", {"D": 9}, {"Q": 2}),
        "lut": cell("LUT2", {"I0": 2, "I1": 9}, {"O": 3}),
        "carry": cell("CARRY4", {"S": 3}, {"O": 4}),
        "ram": cell("RAM32X1D", {"DPRA0": 4, "D": 7}, {"DPO": 5}),
        "sink": cell("FDRE", {"D": 5}, {"Q": 6}),
        "before data": cell("LUT1", {"I0": 6}, {"O": 7}),
    }
    assert synthesis.logic_levels({"cells": cells}) == 3
    cells["after"] = cell("LUT1", {"I0": 5}, {"O": 8})
    assert synthesis.logic_levels({"cells": cells}) == 4
    assert synthesis.logic_levels({"cells": {"source": cells["source"]}}) == 0
