"""Backends by name."""

import pytest

from sim.backends import interface


def test_unknown_backend_names_the_valid_ones() -> None:
    with pytest.raises(interface.BackendError, match="unknown backend 'fpga'; valid: golden, rtl, board"):
        interface.load_backend("fpga")
