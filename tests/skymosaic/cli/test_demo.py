"""What the demonstration says of the hardware that it simulates."""

from dataclasses import replace
from pathlib import Path

import pytest

from sim.backends.errors import BackendError
from sim.backends.interface import Mismatch
from sim.simulators.scoreboard import Coverage
from skymosaic.cli import demo
from skymosaic.cli.session import session
from skymosaic.common.errors import RegistrationError
from skymosaic.evaluation.hardware import Comparison
from skymosaic.registration.options import BackendOptions

COMPARED = Comparison(
    None, Coverage(2, (900, 100), 16, 300), (308_200, 308_700), 0.5, 0.08, (640, 480), (), (), {"rules": "aerial"}
)


def compare_with(found: Comparison | Exception, monkeypatch: pytest.MonkeyPatch) -> None:
    def compare(*_: object, **__: object) -> Comparison:
        if isinstance(found, Exception):
            raise found
        return found

    monkeypatch.setattr(demo, "compare", compare)
    demo._compare_hardware((Path("left.png"), Path("right.png")), BackendOptions(backend="rtl"))


def test_clocks_and_equality_are_told(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    compare_with(COMPARED, monkeypatch)
    told = capsys.readouterr().out
    assert f"equal to the golden model bit for bit: {COMPARED.coverage}" in told
    assert "308200 clocks per frame, 1.23 M per second" in told
    assert session.numbers["hardware"]["equal"]
    assert 0 <= session.seconds["hardware"] < 60


def test_a_difference_is_an_error_and_a_missing_compiler_is_not(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    compare_with(BackendError("g++ is not installed"), monkeypatch)
    assert "hardware not simulated: g++ is not installed" in capsys.readouterr().err
    with pytest.raises(RegistrationError, match="differ: frame 1, half, level 1, x 3, y 4: expected 10, got 11"):
        compare_with(replace(COMPARED, mismatch=Mismatch(1, "half, level 1", 3, 4, 10, 11)), monkeypatch)
