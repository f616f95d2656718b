"""Backends by name."""

from pathlib import Path

import pytest

from sim.backends import interface
from sim.backends.errors import BackendError


def test_unknown_backend_names_the_valid_ones() -> None:
    with pytest.raises(BackendError, match="unknown backend 'fpga'; valid: golden, rtl, board"):
        interface.load_backend("fpga")


@pytest.mark.parametrize("name", ["golden", "board:somewhere"])
def test_only_a_simulation_has_waves(tmp_path: Path, name: str) -> None:
    with pytest.raises(BackendError, match=f"the backend {name.partition(':')[0]} cannot write waves; use rtl"):
        interface.load_backend(name, waves=tmp_path / "waves.vcd")
    assert not (tmp_path / "waves.vcd").exists()
