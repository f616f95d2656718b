"""Settings of every test, how `make test` shares them out, and the command line in a test's process."""

import os
import sys
from pathlib import Path

import pytest
from hypothesis import settings

from sim.simulators.compiler import QUICK_COMPILE
from skymosaic.cli import main

# The same examples on every machine, and no limit on time that a busy one would break.
settings.register_profile("reproducible", derandomize=True, database=None, deadline=None)
settings.load_profile("reproducible")

# Tests simulate few frames: most of their time is the compiler's. Processes that they start inherit this.
os.environ[QUICK_COMPILE] = "1"

ROOT = Path(__file__).parents[1]
LONG_FILES = (
    "tests/hdl/test_front_end.py",
    "tests/system/test_accelerator.py",
    "tests/sim/cocotb/test_runner.py",
    "tests/formal/test_banks.py",
    "tests/system/test_sequence_rtl.py",
    "tests/system/board/test_board.py",
)
"""Files that compile a simulator or prove for long. They run first, so that no process is left with one at the end; the
first two need different builds, and the last two that of the accelerator's test."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Put `LONG_FILES` first; `make test` gives whole files to its processes in this order."""
    ranks = {ROOT / file: rank for rank, file in enumerate(LONG_FILES)}
    items.sort(key=lambda item: ranks.get(item.path, len(ranks)))


@pytest.fixture
def public_data() -> Path:
    """The folder of public photographs that SKYMOSAIC_DATA names; without it, the test is skipped."""
    folder = os.environ.get("SKYMOSAIC_DATA")
    if not folder:
        pytest.skip("needs the public photographs: set SKYMOSAIC_DATA to their folder")
    return Path(folder)


@pytest.fixture
def run(tmp_path: Path, capfdbinary: pytest.CaptureFixture[bytes], monkeypatch: pytest.MonkeyPatch):
    """Exit status, standard output and standard error of a command in the temporary folder."""
    monkeypatch.chdir(tmp_path)

    def command(*words: str) -> tuple[int, bytes, str]:
        monkeypatch.setattr(sys, "argv", ["skymosaic", *words])
        with pytest.raises(SystemExit) as end:
            main()
        printed = capfdbinary.readouterr()
        return int(end.value.code or 0), printed.out, printed.err.decode()

    return command
