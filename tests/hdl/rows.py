"""A table of rows as the parameters of a test."""

from collections.abc import Callable

import pytest

from hdl.blocks.vectors import Block
from sim.benches.rows import Row


def table(**each: Row | Callable[[], Block]) -> pytest.MarkDecorator:
    """Parametrise a test by ``row``; the names of the rows are words."""
    made = {name.replace("_", " "): row if isinstance(row, Row) else Row(row) for name, row in each.items()}
    return pytest.mark.parametrize("row", made.values(), ids=made)
