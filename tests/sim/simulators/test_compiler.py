"""What a compiler says that fails."""

import sys

import pytest

from sim.backends.errors import BackendError
from sim.simulators.compiler import run_tool


@pytest.mark.parametrize(
    ("script", "says"),
    [
        ("import sys; print('a note'); sys.exit('x.cpp:3: Error: y is no type')", "x.cpp:3: Error: y is no type"),
        ("raise SystemExit(7)", "exit status 7"),
    ],
)
def test_a_compiler_that_fails_is_one_line_with_its_reason(script: str, says: str) -> None:
    with pytest.raises(BackendError, match=f" failed: {says}$"):
        run_tool([sys.executable, "-c", script])
    run_tool([sys.executable, "-c", ""])
