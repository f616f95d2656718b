"""The tools are compiled before the first proof."""

import pytest

from tests.formal.proofs import compile_yosys


@pytest.fixture(scope="session", autouse=True)
def yosys() -> None:
    compile_yosys()
