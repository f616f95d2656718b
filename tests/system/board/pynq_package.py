"""PYNQ's own Overlay, DMA, MMIO and PynqBuffer on a PC: only what reaches /dev or the FPGA manager is replaced.

The source package is fetched into the user's cache, not installed, since it pins an old NumPy:

    python -m tests.system.board.pynq_package
"""

from __future__ import annotations

import importlib
import os
import subprocess
import sys
import tarfile
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

from golden_model.cache import cache_folder
from sim.backends.errors import BackendError
from sim.backends.interface import Progress, silent
from sim.simulators.build_cache import build_once

NEWEST = "4.0.0"
OLDER = ("3.1.2", "3.0.1")
"""3.1.2 is the newest one with images for the Zynq-7000."""
FILES = ("overlay", "mmio", "buffer", "lib/dma", "_3rdparty/tinynumpy")
BUILD_CONSTRAINT = "setuptools<80"
"""PYNQ's setup.py, which pip runs to learn the package's name, needs commands that newer ones lack."""


def fetch_pynq(version: str, progress: Progress = silent) -> Path:
    """Return a folder with PYNQ's modules in ``pynq/``, fetched the first time.

    Raises
    ------
    BackendError
        If pip cannot fetch it, for example offline.
    """

    def build(folder: Path) -> None:
        archive = _download(version, folder)
        with tarfile.open(archive) as package:
            for name in FILES:
                member = package.extractfile(f"pynq-{version}/pynq/{name}.py")
                assert member is not None
                path = folder / "pynq" / f"{name}.py"
                path.parent.mkdir(parents=True, exist_ok=True)
                path.write_bytes(member.read())
        archive.unlink()

    return build_once(f"pynq-{version}", build, what=f"modules of PYNQ {version}", progress=progress)


def is_fetched(version: str = NEWEST) -> bool:
    """Whether the cache has PYNQ's modules."""
    return (cache_folder() / f"pynq-{version}.entry").exists()


def _download(version: str, folder: Path) -> Path:
    constraints = folder / "constraints.txt"
    constraints.write_text(BUILD_CONSTRAINT)
    # Which of the two variables constrains the build depends on pip's version.
    environment = {"PIP_CONSTRAINT": str(constraints), "PIP_BUILD_CONSTRAINT": str(constraints)}
    words = ("download", "--quiet", "--no-deps", "--no-binary", "pynq", "--dest", str(folder), f"pynq=={version}")
    command = [sys.executable, "-m", "pip", "--disable-pip-version-check", *words]
    done = subprocess.run(command, env=os.environ | environment, capture_output=True, text=True, check=False)
    archive = folder / f"pynq-{version}.tar.gz"
    if done.returncode or not archive.exists():
        errors = [line for line in done.stderr.splitlines() if line.startswith("ERROR")] or ["no archive"]
        raise BackendError(f"cannot fetch PYNQ {version} ({errors[-1]}); connect to the package index, and try again")
    constraints.unlink()
    return archive


class ReprDict(dict[str, Any]):
    """Stands for that of pynqutils: a dictionary with a name for printing."""

    def __init__(self, *args: Any, rootname: str = "root", **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self.rootname = rootname


class Bitstream:
    """Stands for PYNQ's, which writes the FPGA manager."""

    def __init__(self, bitfile_name: str, dtbo: str | None, *, partial: bool, device: Any) -> None:
        self.device = device or sys.modules["pynq"].Device.active_device
        self.bitfile_name, self.dtbo, self.timestamp = bitfile_name, dtbo, ""

    def download(self, parser: Any) -> None:
        """Load the bitstream: the design starts again."""
        self.device.download(self.bitfile_name)


def import_pynq(version: str, device: Any) -> ModuleType:
    """Put PYNQ's package ``pynq`` into `sys.modules`, with ``device`` as its active device.

    Parameters
    ----------
    version : str
        `NEWEST` or one of `OLDER`.
    device : object
        What PYNQ asks of a device: see `tests.system.board.pynq_board.Board`.
    """
    remove_pynq()
    folder = fetch_pynq(version) / "pynq"
    pynq = _module("pynq", Device=SimpleNamespace(active_device=device))
    pynq.__path__ = [str(folder)]
    nothing = type("Nothing", (), {})
    clocks = SimpleNamespace(set_device=lambda _: None, set_pl_clk=lambda *_, **__: None)
    extensions = SimpleNamespace(ExtensionsManager=lambda _: SimpleNamespace(list=[]))
    _module("pynqutils", runtime=SimpleNamespace(ReprDict=ReprDict), setup_utils=extensions)
    _module("pynqutils.runtime.repr_dict", ReprDict=ReprDict)
    _module("pynqmetadata.frontends", Metadata=nothing)
    _module("pynqmetadata.views.runtime.append_drivers_pass", bind_drivers_to_metadata=None)
    _module("pynq.metadata.append_drivers_pass", bind_drivers_to_metadata=None)
    _module("pynq.bitstream", Bitstream=Bitstream)
    _module("pynq.ps", ON_TARGET=False, Clocks=clocks)
    _module("pynq.registers", RegisterMap=nothing)
    _module("pynq.gpio", GPIO=nothing)
    _module("pynq.interrupt", Interrupt=type("Interrupt", (), {"__init__": lambda self, pin: None}))
    for name in ("pynq.pl_server", "pynq.pl_server.device"):
        _module(name, Device=pynq.Device)
    for name in ("pynq._3rdparty.ert", "pynq._3rdparty.xrt"):  # of PYNQ 3.0
        _module(name)
    members = {
        "pynq.mmio": ("MMIO",),
        "pynq.buffer": ("PynqBuffer", "allocate"),
        "pynq.overlay": ("Overlay", "DefaultIP", "UnsupportedConfiguration"),
    }
    for module, names in members.items():
        loaded = importlib.import_module(module)
        vars(pynq).update({name: getattr(loaded, name) for name in names})
    importlib.import_module("pynq.lib.dma")
    return pynq


def remove_pynq() -> None:
    """Forget the package and all that was put beside it."""
    for name in [name for name in sys.modules if name.partition(".")[0] in ("pynq", "pynqutils", "pynqmetadata")]:
        del sys.modules[name]


def _module(name: str, **members: Any) -> ModuleType:
    module = ModuleType(name)
    vars(module).update(members)
    sys.modules[name] = module
    return module


if __name__ == "__main__":
    try:
        fetch_pynq(NEWEST, print)
    except BackendError as error:
        sys.exit(str(error))
