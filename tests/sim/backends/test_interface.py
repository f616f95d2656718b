"""Backends by name."""

import pytest

from sim.backends import interface
from sim.backends.errors import BackendError


def test_unknown_backend_names_the_valid_ones() -> None:
    with pytest.raises(BackendError, match="unknown backend 'fpga'; valid: golden, rtl, board"):
        interface.load_backend("fpga")
