"""Settings of every test, and how tests are shared out: `make test` runs them in two processes."""

import os
from pathlib import Path

import pytest
from hypothesis import settings

from sim.compiled import QUICK_COMPILE

# The same examples on every machine, and no limit on time that a busy one would break.
settings.register_profile("reproducible", derandomize=True, database=None, deadline=None)
settings.load_profile("reproducible")

# Tests simulate few frames: most of their time is the compiler's. Processes that they start inherit this.
os.environ[QUICK_COMPILE] = "1"

ROOT = Path(__file__).parents[1]
GROUPS = {
    "tests/hdl/test_front_end.py": "front end",
    "tests/system/test_accelerator.py": "accelerator",
    "tests/system/test_sequence_rtl.py": "accelerator",
    "tests/system/test_board.py": "accelerator",
    "tests/system/test_cocotb.py": "cocotb",
    "tests/formal/test_banks.py": "proof of banks",
}
"""Files whose tests run in one process, since they share a build, or a proof that takes long; the longest first."""


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Run long files first, so that no process is left with one at the end, and each file in one process."""
    order = list(GROUPS)

    def file(item: pytest.Item) -> str:
        return item.path.relative_to(ROOT).as_posix()

    for item in items:
        item.add_marker(pytest.mark.xdist_group(GROUPS.get(file(item), file(item))))
    items.sort(key=lambda item: order.index(file(item)) if file(item) in GROUPS else len(order))
