"""Tables as text, and as pandas and polars take them: a dictionary of columns, each a NumPy array, one entry a row."""

import csv
import io
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

Table = dict[str, NDArray[Any]]


def to_csv(header: Iterable[str], rows: Iterable[Iterable[object]]) -> str:
    """The text of a file with a header and rows."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(header)
    writer.writerows(rows)
    return text.getvalue()


def tabulate(rows: Iterable[Mapping[str, Any]]) -> Table:
    """The columns of rows that all have the same keys; None is NaN in a column of numbers."""
    listed = list(rows)
    columns = {name: [row[name] for row in listed] for name in (listed[0] if listed else ())}
    return {name: np.array([np.nan if each is None else each for each in column]) for name, column in columns.items()}
