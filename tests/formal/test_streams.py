# amaranth: UnusedElaboratable=no
from collections.abc import Callable
from functools import partial
from pathlib import Path

import pytest

from hdl.blocks.vectors import Block
from tests.formal.proofs import StreamContract, prove
from tests.hdl.lib.test_rows import buffer, queue
from tests.hdl.test_rows import Wrong


@pytest.mark.parametrize(
    ("make", "depth"),
    [
        pytest.param(buffer, 2, id="buffer"),
        # Those on their way, those in the queue, and one whose place is just known to be free.
        pytest.param(partial(queue, 2), 5, id="queue"),
    ],
)
def test_a_row_keeps_the_contract(tmp_path: Path, make: Callable[[], Block], depth: int) -> None:
    prove(StreamContract(make().component, depth=depth), tmp_path)


def test_the_checker_finds_a_forgetful_stage(tmp_path: Path) -> None:
    with pytest.raises(AssertionError, match="FAIL"):
        prove(StreamContract(Wrong("forgets"), depth=2), tmp_path)
