"""What a comparison with hardware says, and how it ends."""

from dataclasses import replace

import pytest

from sim.backends.interface import Mismatch
from skymosaic.cli import compare
from tests.conftest import Run
from tests.skymosaic.cli.test_demo import COMPARED


def test_a_difference_is_told_and_ends_with_status_1(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    different = replace(COMPARED, mismatch=Mismatch(0, "matches", None, None, 3, 2), notes=("there is no corner",))
    for found, verdict, ends_with in ((different, f"NOT EQUAL: {different.mismatch}", 1), (COMPARED, "equal", 0)):
        monkeypatch.setattr(compare, "compare_pair", lambda *_, result=found, **__: result)
        status, printed, errors = run("compare", "left.png", "right.png")
        assert status == ends_with
        assert printed.decode().splitlines()[:4] == [
            verdict,
            f"compared {found.coverage}",
            "cycles per frame 308200, 308700",
            "1.23 M cycles/s simulated",
        ]
        assert ("proves little: there is no corner" in errors) == bool(found.notes)
