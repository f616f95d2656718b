"""Settings of every test, how `make test` shares them out, and the command line in a test's process."""

import os
import signal
import sys
from collections.abc import Callable, Generator
from pathlib import Path
from typing import TypeVar

import pytest
from hypothesis import settings

from sim.simulators.compiler import QUICK_COMPILE
from skymosaic.cli import main
from tests.needs import find_unmet_needs

# The same examples on every machine, and no limit on time that a busy one would break.
settings.register_profile("reproducible", derandomize=True, database=None, deadline=None)
settings.load_profile("reproducible")

# Tests simulate few frames: most of their time is the compiler's. Processes that they start inherit this.
os.environ[QUICK_COMPILE] = "1"

# Started in the background, or by nohup, the tests ignore these, and so would what they start and end by them.
signal.signal(signal.SIGHUP, signal.SIG_DFL)
signal.signal(signal.SIGINT, signal.default_int_handler)

LONGEST_FIRST = (
    "tests/system/test_ulx3s.py::test_open_tools_build_the_bitstream",
    "tests/system/test_netlists.py::test_the_netlist_of_a_block_equals_the_golden_model[ilbp",
    "tests/cocotb/test_runner.py::test_chosen_cases_pass_on_icarus",
    "tests/system/test_netlists.py::test_the_netlist_of_a_block_equals_the_golden_model[accelerator",
    "tests/bench/test_synthesis.py",
    "tests/hdl/test_front_end.py",
    "tests/system/test_accelerator.py",
    "tests/cocotb/test_runner.py",
    "tests/formal/test_banks.py",
    "tests/system/test_sequence_rtl.py",
    "tests/system/board/test_board.py",
    "tests/system/test_gallery.py",
    "tests/system/test_terminal.py",
    "tests/system/test_lens.py",
    "tests/system/test_sequence.py",
)
"""Beginnings of the names of long tests. They run first, so that no process is left with one at the end. In `make test`
the first two files of these compile different builds, and two later ones wait for that of the accelerator's test."""


def pytest_addoption(parser: pytest.Parser) -> None:
    """Define ``--require``."""
    parser.addoption("--require", choices=["all"], help="a test that would be skipped fails")


@pytest.hookimpl(tryfirst=True)  # xdist reads the groups in the same hook
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Order tests by `LONGEST_FIRST`, and group them: `make test` gives whole groups to its processes.

    A group is a file, since its tests share fixtures and caches. A slow test that shares no fixture is one by itself.
    """
    items.sort(key=lambda item: next((n for n, name in enumerate(LONGEST_FIRST) if item.nodeid.startswith(name)), 99))
    for item in items:
        if not item.get_closest_marker("slow") or _shares_fixture(item):
            item.add_marker(pytest.mark.xdist_group(item.nodeid.partition("::")[0]))


def _shares_fixture(item: pytest.Item) -> bool:
    definitions = [each[-1] for each in item._fixtureinfo.name2fixturedefs.values()]  # type: ignore[attr-defined]
    # Those of pytest itself have no base.
    return any(each.scope in ("module", "session") and each.baseid for each in definitions)


def pytest_runtest_setup(item: pytest.Item) -> None:
    """Skip a test whose needs are not met."""
    for need in find_unmet_needs(item):
        pytest.skip(f"needs {need.name}: {need.remedy}")


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: pytest.Item) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """Turn a skip into a failure where everything is required."""
    return _fail_if_required(item.config, (yield))


@pytest.hookimpl(wrapper=True)
def pytest_make_collect_report(
    collector: pytest.Collector,
) -> Generator[None, pytest.CollectReport, pytest.CollectReport]:
    """Turn the skip of a whole file into a failure, too."""
    return _fail_if_required(collector.config, (yield))


Report = TypeVar("Report", pytest.TestReport, pytest.CollectReport)


def _fail_if_required(config: pytest.Config, report: Report) -> Report:
    if config.getoption("--require") and report.skipped and not hasattr(report, "wasxfail"):
        reason = report.longrepr[2] if isinstance(report.longrepr, tuple) else report.longrepr
        report.outcome, report.longrepr = "failed", f"--require all: {reason}"
    return report


@pytest.fixture
def public_data() -> Path:
    """The folder of public photographs."""
    return Path(os.environ["SKYMOSAIC_DATA"])


Run = Callable[..., tuple[int, bytes, str]]


@pytest.fixture
def run(tmp_path: Path, capfdbinary: pytest.CaptureFixture[bytes], monkeypatch: pytest.MonkeyPatch) -> Run:
    """Exit status, standard output and standard error of a command in the temporary folder."""
    monkeypatch.chdir(tmp_path)

    def command(*words: str) -> tuple[int, bytes, str]:
        monkeypatch.setattr(sys, "argv", ["skymosaic", *words])
        with pytest.raises(SystemExit) as end:
            main()
        printed = capfdbinary.readouterr()
        return int(end.value.code or 0), printed.out, printed.err.decode()

    return command
