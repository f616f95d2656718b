"""What computes features and matches, by name: the golden model, the simulated hardware, or a board."""

import importlib
from pathlib import Path
from typing import Literal

from golden_model.text import how_to_install
from sim.backends.errors import BackendError
from sim.backends.interface import Backend, Progress, silent

BackendName = Literal["golden", "rtl", "board"]
BACKENDS = {
    "golden": "sim.backends.golden",
    "rtl": "sim.simulators.hardware",
    "board": "skymosaic.features.board_client",
}
"""The module of each backend; ``rtl`` simulates the hardware."""


def load_backend(name: str, *, progress: Progress = silent, waves: Path | None = None) -> Backend:
    """Load the backend ``name``.

    Parameters
    ----------
    name : str
        A key of `BACKENDS`; a board is named with its address, ``board:HOST[:PORT]``.
    progress : callable
        Receives a line of text when something slow (a first build) starts, advances or ends.
    waves : Path or None
        Wave file (VCD) that a simulation writes for each run; the golden model and a board have no waves.

    Raises
    ------
    BackendError
        For an unknown name (the message lists the valid ones), a board without an address, or a wave file that cannot
        be written.
    """
    kind, _, address = name.partition(":")
    if kind not in BACKENDS or (address and kind != "board"):
        raise BackendError(f"unknown backend {name!r}; valid: {', '.join(BACKENDS)}")
    if waves is not None:
        if kind != "rtl":
            raise BackendError(f"the backend {kind} cannot write waves; use rtl")
        try:
            waves.touch()
        except OSError as error:
            raise BackendError(f"cannot write the waves to {waves}: {error.strerror}") from error
    # Imported on demand: the golden model needs neither Amaranth nor a compiler.
    try:
        module = importlib.import_module(BACKENDS[kind])
    except ModuleNotFoundError as error:
        raise BackendError(f"backend {kind} needs {error.name}; {how_to_install('sim')}") from None
    backend: Backend
    if kind == "rtl":
        backend = module.HardwareBackend(progress=progress, waves=waves)
    else:
        backend = module.BoardBackend(address) if kind == "board" else module.GoldenBackend()
    return backend
