"""Cell selection equals a streaming insertion; the order of emission equals the nested loops that define it."""

import itertools
from typing import Any

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray

from golden_model.selection.selection import best_of_cells, emission_order, raster

sparse_codes = st.tuples(st.integers(1, 40), st.integers(1, 40)).flatmap(
    lambda shape: arrays(np.uint16, shape, elements=st.sampled_from([5, 6, 32767]), fill=st.just(0))
)


def naive_best(candidates: NDArray[np.uint16], cell_px: int, per_cell: int) -> list[Any]:
    """Insert in raster order into the sorted list of each cell; of equal responses the earlier one stays ahead."""
    cells: dict[tuple[int, int], list[tuple[int, int, int]]] = {}
    for y, x in itertools.product(*map(range, candidates.shape)):
        code = int(candidates[y, x])
        if code:
            cell = cells.setdefault((y // cell_px, x // cell_px), [])
            place = sum(code <= kept for kept, _, _ in cell)
            cell.insert(place, (code, x, y))
            del cell[per_cell:]
    return [(x, y) for key in sorted(cells) for _, x, y in cells[key]]


@given(candidates=sparse_codes, cell_px=st.sampled_from([4, 8, 32]), per_cell=st.integers(1, 8))
def test_selection_equals_streaming_insertion(candidates: Any, cell_px: Any, per_cell: int) -> None:
    x, y = best_of_cells(candidates, cell_px, per_cell)
    assert list(zip(x, y, strict=True)) == naive_best(candidates, cell_px, per_cell)


@given(candidates=sparse_codes)
def test_raster_order(candidates: Any) -> None:
    x, y = raster(candidates)
    expected = [(u, v) for v, u in itertools.product(*map(range, candidates.shape)) if candidates[v, u]]
    assert list(zip(x, y, strict=True)) == expected


@given(rows=st.tuples(*[st.lists(st.integers(0, 9), max_size=30).map(sorted)] * 2))
def test_two_level_0_rows_leave_before_the_level_1_row_that_covers_them(rows: Any) -> None:
    level = np.repeat([0, 1], [len(rows[0]), len(rows[1])])
    features = list(zip(level, rows[0] + rows[1], range(level.size), strict=True))
    turns = [turn for j in range(10) for turn in ((0, 2 * j), (0, 2 * j + 1), (1, j))]
    expected = [index for turn in turns for its_level, row, index in features if (its_level, row) == turn]
    assert emission_order(level, np.array(rows[0] + rows[1], np.intp)).tolist() == expected
