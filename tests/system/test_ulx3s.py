"""The ULX3S: its top at the pins, through the exported driver, and the bitstream that open tools build of it."""

import dataclasses
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from golden_model.config import PRESETS, EstimatorConfig
from hdl.build import BUILDS, Build
from hdl.serial.link import Message
from hdl.settings import REQUESTED, matched_frame_settings
from sim.benches.exported import host_programs
from sim.scene import make_pair
from skymosaic.features.backends import load_backend
from tests.system.command_line import skymosaic
from tests.system.serial_port import SerialPort

BUILD = BUILDS["ulx3s"]
THESIS = PRESETS["thesis"]
SMALL_CONFIG = dataclasses.replace(THESIS, front_end=dataclasses.replace(THESIS.front_end, max_features=256))
SMALL = dataclasses.replace(BUILD, config=SMALL_CONFIG, lanes=2, max_width_px=160, max_height_px=120)
WHOLE = dataclasses.replace(BUILD, config=dataclasses.replace(BUILD.config, estimator=EstimatorConfig()))
"""As it is built with ``--homography``."""


class Line:
    """A port that answers as it was told, in place of a board."""

    in_waiting = 0

    def __init__(self, *answers: bytes) -> None:
        self.sent, self._answers = b"", [b"", *answers]

    def write(self, data: bytes) -> None:
        self.sent += data

    def read(self, count: int) -> bytes:
        return self._answers.pop(0) if self._answers else b""


@pytest.fixture(scope="module")
def programs() -> Iterator[Any]:
    with host_programs(WHOLE) as load:
        yield load


@pytest.mark.parametrize(("answer", "message"), [(b"login: ", "not from the accelerator"), (b"", "does not answer")])
def test_a_port_without_the_accelerator_is_told_in_one_line(
    programs: Any, monkeypatch: pytest.MonkeyPatch, answer: bytes, message: str
) -> None:
    serial_bus = programs("serial_bus")
    if not answer:
        monkeypatch.setattr(serial_bus, "ANSWER_SECONDS", 0)
    line = Line(answer)
    bus = serial_bus.SerialBus(line)
    with pytest.raises(programs("skymosaic_registers").AcceleratorError, match=message):
        bus.read(8)
    assert line.sent == b"R\x08\x00"


def test_lost_bytes_are_told_once_and_not_after_a_reset(programs: Any) -> None:
    """As of a glitch before the port was opened, or in the frame that is to be sent again."""
    lost, drained = b"A\x80\0\0\0\0", b""
    bus = programs("serial_bus").SerialBus(Line(lost, lost, drained, lost))
    assert bus.read(8) == 0
    with pytest.raises(programs("skymosaic_registers").AcceleratorError, match="bytes were lost"):
        bus.read(8)
    bus.reset()
    assert bus.read(8) == 0


def test_packets_that_mix_with_answers_are_sorted(programs: Any) -> None:
    line = Line(
        bytes([0x10]) + bytes(range(8)) + b"A\0\x78\x56\x34\x12" + bytes([0x21]) + bytes(8),
        bytes([Message.HOMOGRAPHIES | Message.LAST, *range(8), 0x11]) + bytes(8),
    )
    bus = programs("serial_bus").SerialBus(line)
    bus._fetch(64)
    assert bus.read(4) == 0x12345678
    buffers = {name: np.zeros(64, np.uint8) for name in ("features", "matches", "homographies")}
    for name, buffer in buffers.items():
        bus.start_receive(name, buffer)
    bus.start_send(np.arange(3, dtype=np.uint8), 3)
    assert bus.wait(1) == {"features": 16, "matches": 8, "homographies": 8}
    assert line.sent == b"R\x04\x00L\x03\x00\x00\x01\x02"
    assert buffers["features"][:8].tolist() == list(range(8))


class BuiltBus:
    """The registers of a build, and nothing behind them; it keeps what is written, and resets as writes to -1."""

    def __init__(self, register_map: Any) -> None:
        self.written: list[tuple[int, int]] = []
        self._words: dict[int, int] = {}
        for name, value in register_map.BUILT.items():
            offset, low, _ = register_map.FIELDS[name]
            self._words[offset] = self._words.get(offset, 0) | value << low

    def read(self, offset: int) -> int:
        return self._words.get(offset, 0)

    def write(self, offset: int, value: int) -> None:
        self._words[offset] = value
        self.written.append((offset, value))

    def reset(self) -> None:
        self.written.append((-1, 0))

    def allocate(self, length_bytes: int) -> np.ndarray:
        return np.zeros(length_bytes, np.uint8)


def test_colour_for_a_gray_input_is_refused_before_anything_is_sent(programs: Any) -> None:
    driver = programs("skymosaic_driver")
    accelerator = driver.Accelerator(BuiltBus(programs("skymosaic_map")))
    for accelerator.video_bits in (8, 16):
        accelerator.check_frame((64, 64))
        with pytest.raises(driver.AcceleratorError, match=f"{accelerator.video_bits}-bit input takes gray frames only"):
            accelerator.check_frame((64, 64, 3))


def test_what_a_run_has_left_is_cleared_between_two_resets(programs: Any) -> None:
    driver, register_map = programs("skymosaic_driver"), programs("skymosaic_map")
    bus = BuiltBus(register_map)
    accelerator = driver.Accelerator(bus)
    accelerator._recover()
    assert [offset for offset, _ in bus.written] == [-1, register_map.FIELDS["clear"][0], -1]
    offset, low, _ = register_map.FIELDS["clearing"]
    bus.write(offset, 1 << low)
    with pytest.raises(driver.AcceleratorError, match="a packet does not end after a clear"):
        accelerator._recover()


@pytest.mark.slow
@pytest.mark.parametrize(("build", "size_px"), [(SMALL, (96, 72)), (WHOLE, (128, 96))], ids=["small", "whole"])
def test_bits_in_and_records_out_equal_the_golden_model(build: Build, size_px: tuple[int, int]) -> None:
    """At the baud of the bitstream, from the driver down to the pins."""
    port, config = SerialPort(build, progress=print), build.config
    images = [np.ascontiguousarray(image[..., 1]) for image in make_pair(seed=9, size=size_px).images]
    settings = matched_frame_settings(config, *size_px, gray_input=True)
    with host_programs(build) as load:
        accelerator = load("skymosaic_driver").Accelerator(load("serial_bus").SerialBus(port), 1e6)
        requested = {name: settings[name] for name in REQUESTED}
        requested |= vars(config.estimator) if config.estimator else {}
        found = accelerator.run(images, requested, hold_reference=True)
    for frame, expected in zip(found, load_backend("golden").run(images, config), strict=True):
        np.testing.assert_array_equal(frame.features, expected.features)
        np.testing.assert_array_equal(frame.matches, expected.matches)
        if config.estimator:
            assert frame.homography.tolist() == expected.homography.tolist()
    assert len(found[1].matches) > 10
    assert port.broken == 0
    print(f"{port.model.cycle} clocks; {len(found[1].features)} features, {len(found[1].matches)} matches")
    port.model.close()


@pytest.mark.slow
@pytest.mark.needs("place_and_route")
def test_open_tools_build_the_bitstream(tmp_path: Path) -> None:
    result = skymosaic("export", "board", "ulx3s", "--build", "-o", "made", cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    assert (tmp_path / "made" / "build" / "skymosaic.bit").stat().st_size > 100_000
    print(result.stdout)
