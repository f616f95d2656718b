"""Every feature gets its place among those of its cell, against lists that Python sorts."""

from typing import Any

import numpy as np
import pytest

from golden_model.feature.ilbp import PATTERNS
from hdl.selection.cell_ranking import CellRanking
from tests.hdl.drivers import run_clocks

PATTERN = PATTERNS["thesis-ilbp-1"]
CELLS, CELL_LOG2 = 3, 6


def order_of(places: list[tuple[int, int]], count: int) -> list[tuple[int, int]]:
    """``(taken, feature)`` of each place; free places hold feature 0."""
    return [(1, number) for _, number in places] + [(0, 0)] * (count - len(places))


@pytest.mark.parametrize("spacing_cycles", [1, 2])
@pytest.mark.parametrize("per_cell", [1, 3, 8])
def test_features_are_ranked_as_python_sorts_them(per_cell: int, spacing_cycles: int) -> None:
    """Two cell rows with many equal responses, of which the earlier is kept; features as close as they may be."""
    dut = CellRanking(pattern=PATTERN, cells=CELLS, spacing_cycles=spacing_cycles)
    rng = np.random.default_rng(per_cell)
    idle: list[tuple[Any, Any]] = [(dut.i, {})]
    clocks = [[(dut.i_cell_log2, CELL_LOG2), (dut.i_per_cell, per_cell), *idle]]
    clears: list[int] = []
    expected, number = {}, 0
    for _ in range(2):
        ranked: list[list[tuple[int, int]]] = [[] for _ in range(CELLS)]
        for cell in rng.choice(CELLS, 60, p=[0.6, 0.4, 0.0]).tolist():
            number += 1
            response = int(rng.integers(1, 8))
            # Responses fall; of equal ones the first stays in front.
            places = sorted([*ranked[cell], (response, number)], key=lambda place: (-place[0], place[1]))
            ranked[cell] = places[:per_cell]
            if (response, number) in ranked[cell]:
                touched = sum(1 << at for at, each in enumerate(ranked) if each)
                expected[len(clocks)] = cell, number, order_of(ranked[cell], 8), len(places) <= per_cell, touched
            x = int(cell << CELL_LOG2) + int(rng.integers(1 << CELL_LOG2))
            feature = {"response": response, "x": number}
            clocks.append([(dut.i, {"present": 1, "x": x, "feature": feature})])
            clocks += [idle] * (spacing_cycles - 1 + int(rng.integers(2)))
        # The row's last feature is ranked in the clock of the clear, and the next row's first may be located in it.
        last = max(clock for clock, row in enumerate(clocks) if row is not idle)
        del clocks[last + 1 :]
        clocks.append(idle)
        clears.append(last + dut.latency_cycles)
    clocks += [idle] * dut.latency_cycles
    clocks = [[*row, (dut.i_clear, clock in clears)] for clock, row in enumerate(clocks)]
    ports = [dut.o_kept, dut.o_cell, dut.o_slot, dut.o_feature.x, dut.o_order, dut.o_added, dut.o_touched]
    found = {}
    slots: dict[tuple[int, int], int] = {}
    for clock, (kept, cell, slot, feature, order, added, touched) in enumerate(run_clocks(dut, clocks, ports)):
        if kept:
            slots[cell, slot] = feature
            places = [(place.taken, slots[cell, place.slot] if place.taken else 0) for place in order]
            found[clock - dut.latency_cycles] = cell, feature, places, bool(added), touched
    assert found == expected
