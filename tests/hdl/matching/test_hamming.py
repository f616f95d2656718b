"""Distances in the chain of lanes, and the nearest neighbours that a lane keeps, against the golden model."""

from typing import Any

import numpy as np
import pytest

from golden_model.matching import hamming
from hdl.matching.hamming import Distances, Lane
from tests.hdl.drivers import run_clocks
from tests.hdl.matching.descriptors import close_together, descriptor_ints, nearest


@pytest.mark.parametrize(("bits", "lanes"), [(8, 2), (32, 4), (128, 2)])
def test_each_lane_has_the_distance_of_each_right_descriptor_a_clock_later(bits: int, lanes: int) -> None:
    """Two passes over the lanes; in the second the last lane is empty. Right descriptors come with gaps."""
    rng = np.random.default_rng(bits)
    dut = Distances(bits=bits, lanes=lanes)
    count = 9
    lefts, rights = close_together(rng, 2 * lanes, bits), close_together(rng, 2 * count, bits)
    arrivals = np.sort(rng.choice(2 * count, count, replace=False))
    clocks, pass_clocks = [], 2 * count + lanes
    for number in range(2):
        values = descriptor_ints(rights[number * count :][:count])
        for clock in range(pass_clocks):
            row: list[tuple[Any, Any]] = [(dut.i_run, 1), (dut.i_valid, 0), (dut.i_load, clock < lanes)]
            if clock in arrivals:
                row += [(dut.i_valid, 1), (dut.i_right, values[arrivals.tolist().index(clock)])]
            if clock < lanes:
                left = descriptor_ints(lefts[number * lanes + clock :][:1])[0]
                empty = number == 1 and clock == lanes - 1
                row += [(dut.i_lane, clock), (dut.i_left, left), (dut.i_left_valid, not empty)]
            clocks.append(row)
    clocks += [[(dut.i_valid, 0)]] * (dut.latency_cycles + lanes)
    sampled = run_clocks(dut, clocks, [dut.o_valid, *dut.o_distances])
    for lane in range(lanes):
        found = {
            clock - dut.latency_cycles - lane: distances[lane]
            for clock, (valid, *distances) in enumerate(sampled)
            if valid >> lane & 1
        }
        expected: dict[int, int] = {}
        for number in range(2):
            if number == 0 or lane != lanes - 1:
                left, right = lefts[number * lanes + lane :][:1], rights[number * count :][:count]
                clocks_in = (number * pass_clocks + arrivals).tolist()
                expected |= dict(zip(clocks_in, hamming.distances(left, right)[0].tolist(), strict=True))
        assert found == expected, f"lane {lane}"


def test_a_lane_keeps_its_nearest_and_passes_on_the_nearest_of_each_column() -> None:
    """The second of four lanes, in two groups of left descriptors: its left indices are 1 and 5."""
    bits, count = 8, 16
    dut = Lane(lane=1, lanes=4, bits=bits, max_features=16)
    # Many are equal. The first group's nearest must not become the second of the second group, whose first is nearest.
    distance = np.random.default_rng(3).integers(2, bits, (2, count))
    distance[0, 5], distance[1, 0] = 0, 1
    none = {"best": 15, "second": 15, "index": 0}
    columns = [dict(none) for _ in range(count)]
    rows = []
    for group in range(2):
        clocks = []
        for right in range(count):
            position = {"group": group, "first_group": group == 0, "right": right}
            position |= {"first": right == 0, "last": right == count - 1}
            bus = {"valid": 1, "position": position, "column": columns[right]}
            clocks.append([(dut.i_valid, 1), (dut.i_distance, int(distance[group, right])), (dut.i_bus, bus)])
        clocks.append([(dut.i_valid, 0), (dut.i_bus, {"valid": 0})])
        sampled = run_clocks(dut, clocks, [dut.o_row_valid, dut.o_row, dut.o_bus])[1:]
        rows += [(row.best, row.second, row.index) for valid, row, _ in sampled if valid]
        columns = [{name: getattr(bus.column, name) for name in none} for _, _, bus in sampled]
    assert rows == nearest(distance, empty=15)
    lefts = np.array([1, 5])
    expected = [(best, second, lefts[index]) for best, second, index in nearest(distance.T, empty=15)]
    assert [tuple(column.values()) for column in columns] == expected
