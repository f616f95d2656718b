"""The board's driver, its server and the host's client, against the accelerator's Verilog.

Only the bus is ours: it turns the driver's register and DMA calls into those of the simulation.
"""

import contextlib
import dataclasses
import importlib
import json
import socket
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from golden_model.config import PRESETS, Config, to_toml
from hdl.settings import REQUESTED, matched_frame_settings
from sim.backends import board
from sim.backends.interface import BUILT_LANES, BackendError, load_backend
from sim.benches.exported import host_programs
from sim.scene import make_pair
from sim.simulators import verilator
from sim.simulators.accelerator_designs import BUILT_SIZES_PX, FEATURES, MATCHES, design_accelerator
from sim.simulators.compiled import Bench
from sim.simulators.recording import END_OF_LINE, Segment
from skymosaic.cli import main
from tests.system.command_line import only_error

SIZE_PX = (160, 120)
BUILT_PX = BUILT_SIZES_PX[0]
CONFIG = PRESETS["aerial"]
FAST = dataclasses.replace(CONFIG, front_end=dataclasses.replace(CONFIG.front_end, detector="fast", threshold=10))
CYCLE_LIMIT, DRAIN_CYCLES = 400_000, 2000


class SimulatedBus:
    """`pynq_bus.PynqBus` over a simulation; a transfer runs when it is waited for."""

    def __init__(self, bench: Bench) -> None:
        self._bench = bench
        self._outputs = {"features": FEATURES, "matches": MATCHES}
        self.read, self.write = bench.read, bench.write
        self._receiving: dict[str, np.ndarray] = {}
        self._data: np.ndarray | None = None

    def allocate(self, length_bytes: int) -> np.ndarray:
        return np.zeros(length_bytes, np.uint8)

    def start_receive(self, channel: str, buffer: np.ndarray) -> None:
        assert channel not in self._receiving
        self._receiving[channel] = buffer

    def start_send(self, buffer: np.ndarray, length_bytes: int) -> None:
        self._data = buffer[:length_bytes].view(np.uint32).copy()

    def wait(self, timeout_seconds: float) -> dict[str, int]:
        if self._data is None:
            # The rest of a packet is drained; its words do not matter.
            with contextlib.suppress(BackendError):
                self._bench.run(Segment(np.zeros(0, np.uint32), np.zeros(0, np.uint8), 1, DRAIN_CYCLES))
            self._receiving = {}
            return {}
        flags = np.zeros(self._data.size, np.uint8)
        flags[-1] = END_OF_LINE
        recording = self._bench.run(Segment(self._data, flags, 1, CYCLE_LIMIT))
        lengths = {}
        for channel, buffer in self._receiving.items():
            packet = recording.outputs[self._outputs[channel]].packets[0].view(np.uint8)
            buffer[: packet.size] = packet
            lengths[channel] = packet.size
        self._receiving, self._data = {}, None
        return lengths

    def reset(self) -> None:
        self._receiving, self._data = {}, None


class InterruptedBus(SimulatedBus):
    """A bus on which the first frame breaks off in the middle."""

    interrupted = False

    def wait(self, timeout_seconds: float) -> dict[str, int]:
        if self.interrupted or self._data is None:
            return super().wait(timeout_seconds)
        self.interrupted = True
        sent = self._data[: self._data.size * 3 // 4]
        self._bench.run(Segment(sent, np.zeros(sent.size, np.uint8), 0, CYCLE_LIMIT))
        raise TimeoutError


@pytest.fixture(scope="module")
def driver() -> Iterator[object]:
    """The driver's modules as they are exported, and their map."""
    with host_programs("pynq", CONFIG, lanes=BUILT_LANES, max_width_px=BUILT_PX[0], max_height_px=BUILT_PX[1]) as load:
        load("skymosaic_driver")
        yield load("skymosaic_server")


@pytest.fixture(autouse=True)
def patient(monkeypatch: pytest.MonkeyPatch) -> None:
    """The host waits for an answer however slowly a busy machine simulates."""
    monkeypatch.setattr(board, "TIMEOUT_SECONDS", None)


@pytest.fixture(scope="module")
def bench() -> Iterator[Bench]:
    design = design_accelerator(CONFIG, BUILT_PX)
    with contextlib.closing(
        Bench(verilator.build_library(design, waves=False, progress=print), design.ports)
    ) as running:
        yield running


@pytest.fixture(scope="module")
def address(driver, bench: Bench) -> Iterator[str]:
    device = sys.modules["skymosaic_driver"].Accelerator(SimulatedBus(bench))
    with driver.Server(("127.0.0.1", 0), device) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        yield f"127.0.0.1:{server.server_address[1]}"
        server.shutdown()
        thread.join()


def frames(*, gray: bool) -> list[np.ndarray]:
    images = list(make_pair(seed=9, size=SIZE_PX).images)
    return [image[..., 1].copy() if gray else image for image in images]


@pytest.mark.parametrize("gray", [True, False])
@pytest.mark.parametrize("reference", ["held", "previous"])
@pytest.mark.parametrize("config", [CONFIG, FAST], ids=["harris", "fast"])
def test_the_board_gives_what_the_golden_model_gives(address: str, gray: bool, reference: str, config: Config) -> None:
    images = [*frames(gray=gray), frames(gray=gray)[0]]
    golden = load_backend("golden").run(images, config, reference=reference)
    found = load_backend(f"board:{address}").run(images, config, reference=reference)
    assert sum(len(frame.features) for frame in golden) > 100
    assert sum(len(frame.matches) for frame in golden) > 20
    for ours, theirs in zip(found, golden, strict=True):
        for name in set(theirs.features.dtype.names) - {"frame"}:
            assert np.array_equal(ours.features[name], theirs.features[name]), name
        for name in theirs.matches.dtype.names:
            assert np.array_equal(ours.matches[name], theirs.matches[name]), name
        assert ours.status["good"]


def command(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, *words: object
) -> tuple[int, str, str]:
    """Exit status, standard output and standard error of ``skymosaic`` and ``words``."""
    monkeypatch.setattr(sys, "argv", ["skymosaic", *map(str, words)])
    with pytest.raises(SystemExit) as end:
        main()
    printed = capsys.readouterr()
    return int(end.value.code or 0), printed.out, printed.err


@pytest.mark.parametrize("name", ["register", "check"])
def test_a_command_asks_the_board_at_an_address(address: str, name: str, tmp_path: Path, capsys, monkeypatch) -> None:
    paths = [tmp_path / "left.png", tmp_path / "right.png"]
    for path, image in zip(paths, frames(gray=False), strict=True):
        cv2.imwrite(str(path), image)
    config = tmp_path / "config.toml"
    config.write_text(to_toml(CONFIG))
    # A board registers in one pass, so the golden model has to as well.
    effort = ("--effort", "fast") if name == "register" else ()
    words = (name, *paths, "--config", config, *effort, "--json")
    _, golden, _ = command(capsys, monkeypatch, *words)
    _, found, errors = command(capsys, monkeypatch, *words, "--backend", "board", "--address", address)
    expected, summary = json.loads(golden), json.loads(found)
    for volatile in ("seconds", "backend"):
        assert expected.pop(volatile, None) != summary.pop(volatile, None) or name == "check", errors
    assert summary == expected


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (("--backend", "board"), "--address HOST"),
        (("--backend", "rtl", "--address", "pynq"), "--backend board"),
        (("--backend", "board", "--address", "127.0.0.1:1"), "no board answers"),
    ],
)
def test_a_wrong_address_is_told_in_one_line(
    options: tuple[str, ...], says: str, tmp_path: Path, capsys, monkeypatch
) -> None:
    for number, image in enumerate([*frames(gray=True), frames(gray=True)[0]]):
        cv2.imwrite(str(tmp_path / f"{number}.png"), image)
    for words in (("register", *sorted(tmp_path.glob("[01].png"))), ("mosaic", tmp_path, "-o", tmp_path / "m.tif")):
        status, _, errors = command(capsys, monkeypatch, *words, *options)
        assert status == 2
        assert says in only_error(errors)


def test_the_server_refuses_what_was_not_built_and_lives_on(address: str) -> None:
    wide = np.zeros((120, 2000), np.uint8)
    with pytest.raises(BackendError, match="width_px is 2000; it must be 64 to 1920"):
        load_backend(f"board:{address}").run([wide, wide], CONFIG)
    host, port = address.split(":")
    for nonsense in (b"GET / HTTP/1.1\r\n", b"{}\n", b'{"shape": [1], "frames": 1}\n'):
        with socket.create_connection((host, int(port))) as connection:
            connection.sendall(nonsense)
            assert b"malformed" in connection.makefile("rb").readline()
    assert load_backend(f"board:{address}").run(frames(gray=True), CONFIG)[0].status["good"]


def test_frames_of_two_sizes_are_refused_before_anything_is_sent() -> None:
    with pytest.raises(BackendError, match="one size"):
        load_backend("board:127.0.0.1:1").run([np.zeros((64, 64), np.uint8), np.zeros((64, 65), np.uint8)], CONFIG)


def test_a_board_that_is_not_there_is_told_in_one_line() -> None:
    with pytest.raises(BackendError, match="no board answers"):
        load_backend("board:127.0.0.1:1").run([np.zeros((64, 64), np.uint8)], CONFIG)


SETTINGS = {
    name: value
    for name, value in matched_frame_settings(CONFIG, *SIZE_PX, gray_input=True).items()
    if name in REQUESTED
}


def test_a_run_after_an_interrupted_one_is_clean(driver, bench: Bench) -> None:
    """Words of the broken frame wait at the output; the driver takes them before the next frame."""
    device = sys.modules["skymosaic_driver"].Accelerator(InterruptedBus(bench))
    images = frames(gray=True)
    with pytest.raises(TimeoutError):
        device.run(images, SETTINGS, hold_reference=True)
    for found, golden in zip(
        device.run(images, SETTINGS, hold_reference=True), load_backend("golden").run(images, CONFIG), strict=True
    ):
        np.testing.assert_array_equal(found.features, golden.features)
        np.testing.assert_array_equal(found.matches, golden.matches)


@pytest.mark.parametrize("change", [{"width_px": BUILT_PX[0] + 1}, {"height_px": 63}, {"per_cell": 9}])
def test_the_driver_checks_settings_before_it_touches_anything(driver, bench: Bench, change: dict[str, int]) -> None:
    module = sys.modules["skymosaic_driver"]
    device = module.Accelerator(SimulatedBus(bench))
    device.bus = None
    with pytest.raises(module.AcceleratorError, match="it must be"):
        device.run(frames(gray=True), SETTINGS | change, hold_reference=True)


class FakeDma:
    """A DMA of PYNQ; one that is ``stuck`` does not come out of its reset, however often it is asked."""

    MAX_READS = 1000

    def __init__(self, *, stuck: bool) -> None:
        self.stuck, self.registers, self.started, self.reads = stuck, {0x00: 1, 0x30: 1}, 0, 0
        self.sendchannel = self.recvchannel = SimpleNamespace(start=self.start)

    def start(self) -> None:
        self.started += 1

    def write(self, offset: int, value: int) -> None:
        self.registers[offset] = value if self.stuck else 0

    def read(self, offset: int) -> int:
        self.reads += 1
        assert self.reads < self.MAX_READS, "the driver waits without a time limit"
        return self.registers[offset]


def test_the_dmas_are_recovered_by_their_reset_registers(driver, monkeypatch: pytest.MonkeyPatch) -> None:
    dmas = {name: FakeDma(stuck=False) for name in ("dma_video", "dma_features", "dma_matches")}
    pynq = SimpleNamespace(
        DefaultIP=object, Overlay=lambda _: SimpleNamespace(skymosaic=FakeDma(stuck=False), **dmas), allocate=None
    )
    monkeypatch.setitem(sys.modules, "pynq", pynq)
    pynq_bus = importlib.import_module("pynq_bus")
    monkeypatch.delitem(sys.modules, "pynq_bus")
    monkeypatch.setattr(pynq_bus, "RESET_SECONDS", 0.01)
    bus = pynq_bus.PynqBus("skymosaic.bit")
    bus.reset()
    assert [dma.started for dma in dmas.values()] == [1, 1, 1]
    dmas["dma_matches"].stuck = True
    with pytest.raises(sys.modules["skymosaic_driver"].AcceleratorError, match="matches does not reset"):
        bus.reset()


@pytest.mark.parametrize("name", ["built_lanes", "version_minor", "version_major"])
def test_another_build_is_refused(driver, bench: Bench, monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    monkeypatch.setitem(sys.modules["skymosaic_map"].BUILT, name, 7)
    with pytest.raises(sys.modules["skymosaic_driver"].AcceleratorError, match="same export"):
        sys.modules["skymosaic_driver"].Accelerator(SimulatedBus(bench))


def test_another_patch_version_is_accepted(driver) -> None:
    built, fields = sys.modules["skymosaic_map"].BUILT, sys.modules["skymosaic_map"].FIELDS
    assert {"version_major", "version_minor"} <= built.keys()
    assert "version_patch" in fields.keys() - built.keys()


def test_frames_fit_the_builds_video_input(driver) -> None:
    as_words, gray = sys.modules["skymosaic_driver"].as_words, np.arange(6, dtype=np.uint8).reshape(2, 3)
    assert as_words(gray, 24).tolist() == gray.ravel().tolist()
    assert as_words(gray, 8).view(np.uint8)[:6].tolist() == as_words(gray, 32).view(np.uint8)[:6].tolist()
    for bits in (8, 16):
        with pytest.raises(sys.modules["skymosaic_driver"].AcceleratorError, match=f"{bits}-bit input"):
            as_words(np.zeros((2, 3, 3), np.uint8), bits)
    # Two pixels at once: lines of three pixels get a fourth, and colours come as R, G, B of both.
    assert as_words(gray, 16).view(np.uint8).tolist() == [0, 1, 2, 0, 3, 4, 5, 0]
    pairs = as_words(gray, 48).view(np.uint64).tolist()
    assert pairs == [0 | 1 << 24, 2, 3 | 4 << 24, 5]
    assert as_words(np.arange(6, dtype=np.uint8).reshape(1, 2, 3), 48).view(np.uint8).tolist() == [
        2,
        1,
        0,
        5,
        4,
        3,
        0,
        0,
    ]
