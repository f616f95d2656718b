"""AXI agents around the accelerator: frames in, results out."""

from __future__ import annotations

import logging
import random
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

import cocotb
import numpy as np
from cocotb.clock import Clock
from cocotb.triggers import ClockCycles, RisingEdge
from cocotbext.axi import (
    AxiLiteBus,
    AxiLiteMaster,
    AxiResp,
    AxiStreamBus,
    AxiStreamFrame,
    AxiStreamSink,
    AxiStreamSource,
)
from numpy.typing import NDArray

from golden_model.arrays import Pixels
from golden_model.front_end import extract
from hdl.registers.register_map import REGISTERS, register_writes
from hdl.settings import RUNNING, matched_frame_settings
from sim.backends.golden import add_matches
from sim.backends.interface import FrameResult, Reference
from sim.scene import make_pair
from sim.simulators.accelerator_designs import CONTROL, FEATURES, MATCHES
from sim.simulators.hardware import decode_frame
from sim.simulators.recording import flatten_frame
from sim.simulators.scoreboard import find_mismatch
from tests.cocotb.runner import CONFIG

CLOCK_NS = 10
RESET_CYCLES = 4
REGISTER_BYTES = 4
FIELDS = {field.name: (register.offset, field) for register in REGISTERS for field in register.fields}


class Bench:
    """The accelerator, running after a reset, with a manager at its registers, a source of pixels and two packet sinks.

    Parameters
    ----------
    dut
        cocotb's handle of the top module; `open` also starts its clock and resets it.

    Attributes
    ----------
    registers : AxiLiteMaster
    video : AxiStreamSource
        A packet is a line in video mode, a transfer in memory mode.
    sinks : dict of str to AxiStreamSink
        By port prefix.
    """

    def __init__(self, dut: Any) -> None:
        self.dut = dut
        logging.getLogger("cocotb.top").setLevel(logging.WARNING)
        wires = {"clock": dut.aclk, "reset": dut.aresetn, "reset_active_level": False}
        self.registers = AxiLiteMaster(AxiLiteBus.from_prefix(dut, CONTROL), **wires)
        self.video = AxiStreamSource(AxiStreamBus.from_prefix(dut, "s_axis_video"), byte_lanes=1, **wires)
        self.sinks = {name: AxiStreamSink(AxiStreamBus.from_prefix(dut, name), **wires) for name in (FEATURES, MATCHES)}

    @classmethod
    async def open(cls, dut: Any) -> Bench:
        """Start the clock, and reset."""
        bench = cls(dut)
        Clock(dut.aclk, CLOCK_NS, unit="ns").start()
        dut.aresetn.value = 0
        await ClockCycles(dut.aclk, RESET_CYCLES)
        dut.aresetn.value = 1
        await ClockCycles(dut.aclk, RESET_CYCLES)
        return bench

    def pause_at_random(self, seed: int) -> None:
        """Pause every channel at random, and check that a word that waits at an output does not change."""
        write, read = self.registers.write_if, self.registers.read_if
        control = (write.aw_channel, write.w_channel, write.b_channel, read.ar_channel, read.r_channel)
        for number, channel in enumerate((self.video, *self.sinks.values(), *control)):
            channel.set_pause_generator(_generate_pauses(seed + number))
        self.check_outputs()

    def check_outputs(self) -> None:
        """From now on, check that a word that waits at an output does not change."""
        for name in self.sinks:
            cocotb.start_soon(self._assert_held(name))

    async def _assert_held(self, name: str) -> None:
        valid, ready, *word = (getattr(self.dut, f"{name}_{port}") for port in ("tvalid", "tready", "tdata", "tlast"))
        waiting = None
        while True:
            await RisingEdge(self.dut.aclk)
            offered = [int(part.value) for part in word] if valid.value else None
            assert waiting is None or offered == waiting, f"{name}: a word was withdrawn or changed"
            waiting = None if ready.value else offered

    async def write_word(self, address: int, data: bytes) -> AxiResp:
        """Write ``data`` from ``address`` on; the strobes of the word's other bytes are 0."""
        return (await self.registers.write(address, data)).resp

    async def read_word(self, address: int) -> tuple[AxiResp, int]:
        """Read a word; returns the response, too."""
        answer = await self.registers.read(address, REGISTER_BYTES)
        return answer.resp, int.from_bytes(answer.data, "little")

    async def write(self, **values: int) -> None:
        """Write fields; the other fields of their registers get their reset values."""
        for address, word in register_writes(values):
            assert await self.write_word(address, word.to_bytes(REGISTER_BYTES, "little")) == AxiResp.OKAY

    async def read(self, name: str) -> int:
        """Read a field."""
        offset, field = FIELDS[name]
        response, word = await self.read_word(offset)
        assert response == AxiResp.OKAY
        value: int = (word & field.mask) >> field.low
        return value

    async def configure(self, image: Pixels, *, reference: Reference = "held", **values: int) -> None:
        """Write the settings for frames like ``image``, with both outputs enabled."""
        height_px, width_px = image.shape[:2]
        settings = {
            **matched_frame_settings(CONFIG, width_px, height_px, gray_input=image.ndim == 2),
            **RUNNING,
            "hold_reference": int(reference == "held"),
        }
        await self.write(**settings | values)

    async def send(self, packets: Iterable[AxiStreamFrame]) -> None:
        """Queue packets for the video input; it takes them while other calls wait."""
        for packet in packets:
            await self.video.send(packet)

    async def send_video(self, *images: Pixels) -> None:
        """Queue frames line by line, back to back."""
        await self.send(line for image in images for line in make_lines(image))

    async def send_memory(self, *images: Pixels) -> None:
        """Queue frames in one transfer."""
        await self.send([make_transfer(images)])

    async def receive_packet(self, name: str) -> NDArray[np.uint64]:
        """Receive the next packet of an output."""
        packet = await self.sinks[name].recv(compact=False)
        assert all(packet.tkeep)
        return np.frombuffer(bytes(packet.tdata), np.uint64)

    async def receive_frames(self, frames: int) -> list[FrameResult]:
        """Receive the next frames at both outputs."""
        packets = [(await self.receive_packet(FEATURES), await self.receive_packet(MATCHES)) for _ in range(frames)]
        return [decode_frame(*both, CONFIG) for both in packets]


def _generate_pauses(seed: int) -> Iterator[bool]:
    """Random runs of pauses and of activity, 1 to 8 clocks each."""
    rng = random.Random(seed)
    while True:
        yield from [rng.random() < 0.4] * rng.randint(1, 8)


def make_lines(image: Pixels) -> list[AxiStreamFrame]:
    """A frame as AXI4-Stream video: one packet for each line, TUSER with the first pixel."""
    data, _ = flatten_frame(image)
    rows = [row.tolist() for row in data.reshape(image.shape[:2])]
    return [AxiStreamFrame(row, tuser=[int(y == 0 and x == 0) for x in range(len(row))]) for y, row in enumerate(rows)]


def make_transfer(images: Sequence[Pixels]) -> AxiStreamFrame:
    """Frames as a DMA sends them: four gray pixels in each beat, with each frame padded to whole beats; or RGBX."""
    beats: list[int] = []
    for image in images:
        if image.ndim == 2:
            beats += np.pad(image.ravel(), (0, -image.size % 4)).view("<u4").tolist()
        else:
            beats += (
                np.pad(image[..., ::-1], ((0, 0), (0, 0), (0, 1)), constant_values=0xA5).view("<u4").ravel().tolist()
            )
    return AxiStreamFrame(beats)


def render_scene(size_px: tuple[int, int], *, gray: bool) -> list[Pixels]:
    """Two rendered views of a landscape."""
    images = make_pair(seed=3, size=size_px).images
    return [np.ascontiguousarray(image[..., 1]) if gray else image for image in images]


def compute_golden(images: Mapping[int, Pixels], reference: Reference) -> list[FrameResult]:
    """The golden model's results for good frames, by their numbers since reset."""
    extracted = (extract(image, CONFIG.front_end, frame=number) for number, image in images.items())
    results = list(add_matches(extracted, CONFIG, reference))
    assert all(len(frame.features) for frame in results)
    assert any(len(frame.matches) for frame in results)
    return results


def assert_golden(results: Sequence[FrameResult], images: Mapping[int, Pixels], reference: Reference = "held") -> None:
    """Check that the good frames equal the golden model; ``images`` has the good ones by number since reset."""
    mismatch = find_mismatch(compute_golden(images, reference), [results[number] for number in images])
    assert mismatch is None, str(mismatch)
