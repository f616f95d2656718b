"""Rows as columns, and as text."""

import numpy as np

from skymosaic.common.tables import tabulate, to_csv


def test_rows_become_columns_and_none_is_nan_among_numbers() -> None:
    table = tabulate([{"name": "a", "error_px": 0.5}, {"name": "b", "error_px": None}])
    assert table["name"].tolist() == ["a", "b"]
    np.testing.assert_array_equal(table["error_px"], [0.5, np.nan])
    assert tabulate([]) == {}
    assert to_csv(["a", "b"], [[1, None], ["x,y", 2.5]]) == 'a,b\n1,\n"x,y",2.5\n'
