"""Advice in messages."""

import sys

import pytest

from golden_model.text import how_to_install


@pytest.mark.parametrize(
    ("prefix", "active", "says"),
    [
        ("/usr", None, "run pip install '.[sim]'"),
        ("/home/a/.venv", "/home/a/.venv", "run pip install '.[sim]'"),
        ("/home/a/.venv", None, "run '/home/a b/.venv/bin/python' -m pip install '.[sim]'"),
        ("/home/a/.venv", "/home/a/other", "run '/home/a b/.venv/bin/python' -m pip install '.[sim]'"),
    ],
)
def test_an_extra_goes_into_the_environment_that_runs(
    monkeypatch: pytest.MonkeyPatch, prefix: str, active: str | None, says: str
) -> None:
    monkeypatch.setattr(sys, "prefix", prefix)
    monkeypatch.setattr(sys, "base_prefix", "/usr")
    monkeypatch.setattr(sys, "executable", "/home/a b/.venv/bin/python")
    monkeypatch.delenv("VIRTUAL_ENV", raising=False)
    if active is not None:
        monkeypatch.setenv("VIRTUAL_ENV", active)
    assert how_to_install("sim").endswith(says)
