"""Backends by name."""

from pathlib import Path

import pytest

from sim.backends.errors import BackendError
from skymosaic.features.backends import load_backend


@pytest.mark.parametrize("name", ["fpga", "fpga:here", "golden:here", "rtl:7"])
def test_unknown_backend_names_the_valid_ones(name: str) -> None:
    with pytest.raises(BackendError, match=f"unknown backend '{name}'; valid: golden, rtl, board"):
        load_backend(name)


@pytest.mark.parametrize("name", ["golden", "board:somewhere"])
def test_only_a_simulation_has_waves(tmp_path: Path, name: str) -> None:
    with pytest.raises(BackendError, match=f"the backend {name.partition(':')[0]} cannot write waves; use rtl"):
        load_backend(name, waves=tmp_path / "waves.vcd")
    assert not (tmp_path / "waves.vcd").exists()
