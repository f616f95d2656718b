"""The board's driver, its server and the host's client, on PYNQ's own classes and the accelerator's Verilog.

Between them are the AXI DMAs at the level of their registers (`tests.system.board.axi_dma`).
"""

import dataclasses
import functools
import json
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from golden_model.config import Config
from golden_model.config_file import to_toml
from hdl.build import BUILDS
from hdl.settings import REQUESTED, matched_frame_settings
from sim.backends.errors import BackendError
from sim.backends.interface import FrameResult, Reference
from sim.benches.exported import host_programs
from sim.scene import make_pair
from sim.simulators.accelerator_designs import MATCHES
from skymosaic.features import board_client
from skymosaic.features.backends import load_backend
from tests.conftest import Run
from tests.made import write_pictures
from tests.system.board.pynq_board import AcceleratorSystem, open_board
from tests.system.board.pynq_package import OLDER, remove_pynq
from tests.system.command_line import captured, only_error

SIZE_PX = (160, 120)
BUILD = BUILDS["pynq_z2"]
CONFIG = BUILD.config
FAST = dataclasses.replace(CONFIG, front_end=dataclasses.replace(CONFIG.front_end, detector="fast", threshold=10))
pytestmark = pytest.mark.needs("pynq")


@pytest.fixture(scope="module")
def system() -> Iterator[AcceleratorSystem]:
    """The board, with PYNQ's own package in front of it."""
    system = open_board(BUILD)
    yield system
    system.bench.close()
    remove_pynq()


@pytest.fixture(scope="module")
def driver(system: AcceleratorSystem, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    """The driver's modules as they are exported, and their map."""
    with host_programs(BUILD) as load:
        overlay: Any = load("pynq_overlay")
        overlay.LOCK = tmp_path_factory.mktemp("lock") / "lock"
        load("pynq_bus")
        yield load("skymosaic_server")


@pytest.fixture(scope="module")
def device(driver: Any) -> Any:
    """The driver's `Accelerator` behind its `PynqBus`."""
    return sys.modules["skymosaic_driver"].Accelerator(sys.modules["pynq_bus"].PynqBus("skymosaic.bit"))


@pytest.fixture(autouse=True)
def patient(monkeypatch: pytest.MonkeyPatch) -> None:
    """The host waits for an answer however slowly a busy machine simulates."""
    monkeypatch.setattr(board_client, "TIMEOUT_SECONDS", None)


@pytest.fixture(scope="module")
def address(driver: Any, device: Any) -> Iterator[str]:
    with driver.Server(("127.0.0.1", 0), device) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        yield f"127.0.0.1:{server.server_address[1]}"
        server.shutdown()
        thread.join()


@functools.cache
def frames(*, gray: bool, size_px: tuple[int, int] = SIZE_PX) -> list[np.ndarray]:
    images = list(make_pair(seed=9, size=size_px).images)
    return [image[..., 1].copy() if gray else image for image in images]


@pytest.mark.parametrize(
    ("config", "reference", "gray"),
    [(CONFIG, "held", True), (FAST, "previous", False)],
    ids=["harris-held-gray", "fast-previous-colour"],
)
def test_the_board_gives_what_the_golden_model_gives(
    address: str, config: Config, reference: Reference, gray: bool
) -> None:
    images = [*frames(gray=gray), frames(gray=gray)[0]]
    golden = load_backend("golden").run(images, config, reference=reference)
    found = load_backend(f"board:{address}").run(images, config, reference=reference)
    assert sum(len(frame.features) for frame in golden) > 100
    assert sum(len(frame.matches) for frame in golden) > 20
    for ours, theirs in zip(found, golden, strict=True):
        for name in set(theirs.features.dtype.names or ()) - {"frame"}:
            assert np.array_equal(ours.features[name], theirs.features[name]), name
        for name in theirs.matches.dtype.names or ():
            assert np.array_equal(ours.matches[name], theirs.matches[name]), name
        assert ours.status["good"]


@pytest.mark.parametrize("name", ["register", "check"])
def test_a_command_asks_the_board_at_an_address(address: str, name: str, tmp_path: Path, run: Run) -> None:
    write_pictures(tmp_path, frames(gray=False), ("left.png", "right.png"))
    (tmp_path / "config.toml").write_text(to_toml(CONFIG))
    # A board registers in one pass, so the golden model has to as well.
    effort = ("--effort", "fast") if name == "register" else ()
    words = (name, "left.png", "right.png", "--config", "config.toml", *effort, "--json")
    _, golden, _ = run(*words)
    _, found, errors = run(*words, "--backend", "board", "--address", address)
    expected, summary = json.loads(golden), json.loads(found)
    # A second apart, or not.
    assert expected.pop("written") <= summary.pop("written")
    for volatile in ("seconds", "backend"):
        assert expected.pop(volatile, None) != summary.pop(volatile, None) or name == "check", errors
    assert summary == expected


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (("--backend", "board"), "give it with --address"),
        (("--backend", "rtl", "--address", "pynq"), "--backend board"),
        (("--backend", "board", "--address", "127.0.0.1:1"), "no board answers"),
    ],
)
def test_a_wrong_address_is_told_in_one_line(options: tuple[str, ...], says: str, tmp_path: Path, run: Run) -> None:
    write_pictures(tmp_path, [*frames(gray=True), frames(gray=True)[0]])
    for words in (("register", "0.png", "1.png"), ("mosaic", ".", "-o", "m.tif")):
        status, _, errors = run(*words, *options)
        assert status == 2
        assert says in only_error(errors)


def test_frames_of_two_sizes_are_refused_before_anything_is_sent() -> None:
    with pytest.raises(BackendError, match="one size"):
        load_backend("board:127.0.0.1:1").run([np.zeros((64, 64), np.uint8), np.zeros((64, 65), np.uint8)], CONFIG)


SMALL_PX = (96, 80)
SETTINGS = {
    name: value
    for name, value in matched_frame_settings(CONFIG, *SMALL_PX, gray_input=True).items()
    if name in REQUESTED
}


@functools.cache
def golden_frames() -> list[FrameResult]:
    return list(load_backend("golden").run(frames(gray=True, size_px=SMALL_PX), CONFIG))


def check_next_frames(device: Any) -> None:
    """The next run gives what the golden model gives."""
    results = device.run(frames(gray=True, size_px=SMALL_PX), SETTINGS, hold_reference=True)
    assert len(golden_frames()[1].matches) > 3
    for found, expected in zip(results, golden_frames(), strict=True):
        np.testing.assert_array_equal(found.features, expected.features)
        np.testing.assert_array_equal(found.matches, expected.matches)


def run_failing(device: Any, match: str) -> None:
    with pytest.raises(sys.modules["skymosaic_registers"].AcceleratorError, match=match):
        device.run(frames(gray=True, size_px=SMALL_PX), SETTINGS, hold_reference=True)


def test_a_frame_passes_pynqs_own_classes(device: Any) -> None:
    assert "pynq-4.0.0-" in str(sys.modules["pynq.lib.dma"].__file__)
    check_next_frames(device)


@pytest.mark.slow
@pytest.mark.parametrize("version", OLDER)
def test_a_frame_passes_the_classes_of_an_older_pynq(
    version: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """In a process of its own, since the package replaces the one under test."""
    program = (
        "import sys; from pathlib import Path; import tests.system.board.test_board as t\n"
        f"system = t.open_board(t.BUILD, {version!r})\n"
        "with t.host_programs(t.BUILD) as load:\n"
        f"    load('pynq_overlay').LOCK = Path({str(tmp_path / 'lock')!r})\n"
        "    bus = load('pynq_bus').PynqBus('skymosaic.bit')\n"
        "    t.check_next_frames(load('skymosaic_driver').Accelerator(bus))\n"
        "print(sys.modules['pynq.lib.dma'].__file__)\n"
    )
    done = captured([sys.executable, "-c", program])
    assert done.returncode == 0, done.stderr
    assert f"pynq-{version}-" in done.stdout


@pytest.mark.parametrize("share", [0.5, 0.0])
def test_the_run_after_a_memory_error_is_clean(system: AcceleratorSystem, device: Any, share: float) -> None:
    """Words of the broken frame wait at the output; the driver takes them before the next frame."""
    frame_bytes = SMALL_PX[0] * SMALL_PX[1]
    system.board.bad_address = device._sent.device_address + int(share * frame_bytes) // 8 * 8
    run_failing(device, "DMA of the video reports a slave error")
    system.board.bad_address = None
    check_next_frames(device)


def test_an_address_without_memory_and_a_long_packet_are_named(device: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(device._received["features"], "device_address", 0)
    run_failing(device, "DMA of the features reports a decode error")
    monkeypatch.undo()
    check_next_frames(device)
    whole = device._received["features"]
    monkeypatch.setitem(device._received, "features", whole[:320])
    run_failing(device, "DMA of the features reports an internal error: a packet is longer than its buffer")
    monkeypatch.undo()
    check_next_frames(device)


def test_a_halted_channel_is_named(system: AcceleratorSystem, device: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    start = device.bus.start_send

    def stop_and_start(buffer: Any, length: int) -> None:
        system.receiving[MATCHES].receive.reset()
        start(buffer, length)

    monkeypatch.setattr(device.bus, "start_send", stop_and_start)
    run_failing(device, "DMA of the matches is halted")
    monkeypatch.undo()
    check_next_frames(device)


def test_every_wait_has_a_limit(system: AcceleratorSystem, device: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys.modules["pynq_overlay"], "RESET_SECONDS", 0.002)
    system.receiving[MATCHES].is_stuck = True
    run_failing(device, "DMA of the matches does not reset")
    system.receiving[MATCHES].is_stuck = False
    monkeypatch.undo()
    # No pixel is taken: nothing answers.
    write = device.write
    monkeypatch.setattr(device, "write", lambda **fields: write(**fields | {"enable": 0}))
    monkeypatch.setattr(device, "timeout_seconds", 0.01)
    run_failing(device, "no answer within 0.01 s; still busy: features, matches, video")
    monkeypatch.undo()
    check_next_frames(device)


def test_two_processes_do_not_share_an_overlay(driver: Any, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    module = sys.modules["pynq_overlay"]
    monkeypatch.setattr(module, "LOCK", tmp_path / "lock")
    monkeypatch.setattr(module, "_locks", [])
    hold = (
        "import fcntl, sys; f = open(sys.argv[1], 'w'); fcntl.flock(f, fcntl.LOCK_EX)\n"
        "f.write('4711'); f.flush(); print(flush=True); sys.stdin.read()"
    )
    command = [sys.executable, "-c", hold, str(tmp_path / "lock")]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as other:
        other.stdout.readline()
        with pytest.raises(sys.modules["skymosaic_registers"].AcceleratorError, match="process 4711 uses the overlay"):
            sys.modules["pynq_bus"].PynqBus("skymosaic.bit")
        other.communicate()
    assert sys.modules["pynq_bus"].PynqBus("skymosaic.bit").read(0) == int.from_bytes(b"SKYM", "big")


def test_an_overlay_without_the_blocks_is_named(
    driver: Any, system: AcceleratorSystem, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delitem(system.board.parser.ip_dict, "dma_matches")
    with pytest.raises(sys.modules["skymosaic_registers"].AcceleratorError, match="no block dma_matches"):
        sys.modules["pynq_bus"].PynqBus("skymosaic.bit")


def test_a_frame_longer_than_a_transfer_is_refused_before_anything_is_sent(
    device: Any, address: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    error = sys.modules["skymosaic_registers"].AcceleratorError
    device.check_frame((4096, 4096))
    device.check_frame((4095, 4096, 3))
    with pytest.raises(error, match="4096x4096 has 67108864 bytes, a DMA sends at most 67108863"):
        device.check_frame((4096, 4096, 3))
    # With two pixels per clock, a line of odd width is sent with one more.
    for bits, shape in ((48, (4096, 4095, 3)), (16, (16384, 4095))):
        device.check_frame(shape)
        monkeypatch.setattr(device, "video_bits", bits)
        device.check_frame((shape[0], shape[1] - 1, *shape[2:]))
        with pytest.raises(error, match=f"4095x{shape[0]} has 67108864 bytes, a DMA sends at most 67108863"):
            device.check_frame(shape)
        monkeypatch.undo()
    with pytest.raises(error, match="67108864 bytes of video; a DMA transfers 1 to 67108863"):
        device.bus.start_send(device._sent, 1 << 26)


@pytest.mark.parametrize("change", [{"width_px": BUILD.max_width_px + 1}, {"height_px": 63}, {"per_cell": 9}])
def test_the_driver_checks_settings_before_it_touches_anything(
    device: Any, change: dict[str, int], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(device, "bus", None)
    with pytest.raises(sys.modules["skymosaic_driver"].AcceleratorError, match="it must be"):
        device.run(frames(gray=True), SETTINGS | change, hold_reference=True)


@pytest.mark.parametrize("name", ["built_lanes", "version_minor", "version_major"])
def test_another_build_is_refused(device: Any, monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    monkeypatch.setitem(sys.modules["skymosaic_map"].BUILT, name, 7)
    with pytest.raises(sys.modules["skymosaic_driver"].AcceleratorError, match="same export"):
        sys.modules["skymosaic_driver"].Accelerator(device.bus)


def test_frames_fit_the_builds_video_input(driver: Any) -> None:
    as_words, gray = sys.modules["skymosaic_driver"].as_words, np.arange(6, dtype=np.uint8).reshape(2, 3)
    assert as_words(gray, 24).tolist() == gray.ravel().tolist()
    assert as_words(gray, 8).tolist() == as_words(gray, 32).view(np.uint8)[:6].tolist()
    # Two pixels at once: lines of three pixels get a fourth, and colours come as R, G, B of both.
    assert as_words(gray, 16).view(np.uint8).tolist() == [0, 1, 2, 0, 3, 4, 5, 0]
    pairs = as_words(gray, 48).view(np.uint64).tolist()
    assert pairs == [0 | 1 << 24, 2, 3 | 4 << 24, 5]
    colours = np.arange(6, dtype=np.uint8).reshape(1, 2, 3)
    assert as_words(colours, 48).view(np.uint8).tolist() == [2, 1, 0, 5, 4, 3, 0, 0]
