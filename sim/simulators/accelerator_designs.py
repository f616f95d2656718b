"""The project's designs, ready to be simulated."""

from collections.abc import Callable, Sequence
from dataclasses import replace

from amaranth.lib import wiring

from golden_model.arrays import Pixels
from golden_model.config import MAX_FRAME_PX, Config, EstimatorConfig
from hdl.accelerator import AcceleratorTop
from hdl.axi.axi_read import AXI_READ
from hdl.axi.axi_write import AXI_WRITE
from hdl.build import Build, Shell
from hdl.serial.ulx3s import Ulx3s
from hdl.shell.camera_top import CameraTop
from hdl.shell.painting import PORTS
from sim.simulators.design import Design, Ports

FEATURES, MATCHES, HOMOGRAPHIES = "m_axis_features", "m_axis_matches", "m_axis_homographies"
CONTROL = "s_axi_ctrl"


def choose_build(config: Config, frames: Sequence[Pixels]) -> Build:
    """The build in which ``frames`` are simulated: the usual one, or that for frames of any size."""
    build = Build(config=config)
    height_px, width_px = (max(sides) for sides in zip(*(image.shape[:2] for image in frames), strict=True))
    if width_px <= build.max_width_px and height_px <= build.max_height_px:
        return build
    return replace(build, max_width_px=MAX_FRAME_PX, max_height_px=MAX_FRAME_PX)


def design_accelerator(build: Build) -> Design:
    """The whole accelerator in its shell."""
    build = strip_settings(build)
    shells: dict[Shell, tuple[Callable[[Build], wiring.Component], Ports]] = {
        "streams": (AcceleratorTop, Ports(tuple(f"m_axis_{output}" for output in build.outputs), control=CONTROL)),
        "camera": (CameraTop, camera_ports(build)),
        "serial": (Ulx3s, Ports(outputs=(), video="ftdi")),
    }
    top, ports = shells[build.shell]
    return Design(f"the accelerator with {build.shell}", ports, lambda: top(build), str(build))


def camera_ports(build: Build) -> Ports:
    """The ports of a camera build: registers, memory that is written and read, and pictures for a display."""
    buses = dict.fromkeys(build.outputs, AXI_WRITE) | (PORTS if build.painter else {})
    writers, readers = (
        tuple(f"m_axi_{name}" for name, bus in buses.items() if bus is kind) for kind in (AXI_WRITE, AXI_READ)
    )
    outputs = ("m_axis_picture",) if build.painter else ()
    return Ports(outputs, control=CONTROL, writers=writers, readers=readers)


def strip_settings(build: Build) -> Build:
    """The build with fixed values for what is set at run time, so that all settings share one build."""
    config = build.config
    stripped = replace(
        config,
        preset="aerial",
        front_end=replace(config.front_end, detector="harris", threshold=1, cell_px=None, per_cell=None),
        matcher=replace(config.matcher, keep_above=0),
        estimator=EstimatorConfig() if config.estimator else None,
    )
    return replace(build, config=stripped)
