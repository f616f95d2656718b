"""Each test of a command begins as the program does, whatever the one before left of its session."""

import time

import pytest

from skymosaic.cli.session import session


@pytest.fixture(autouse=True)
def begin_session() -> None:
    """A session that prints all, as text."""
    session.begin("", started_s=time.perf_counter(), quiet=False, verbose=False, as_json=False)
