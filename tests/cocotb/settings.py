"""Every frame keeps the settings with which it started, and impossible settings give no good frame."""

from typing import Any

import cocotb
import numpy as np
from cocotb.triggers import ClockCycles

from golden_model.records import Cause
from hdl.settings import RUNNING
from sim.simulators.accelerator_designs import MATCHES
from tests.cocotb.bench import Bench, assert_golden, compute_golden, render_scene
from tests.cocotb.faults import assert_bad
from tests.cocotb.runner import MAX_SIZE_PX

SIZE_PX, OTHER_SIZE_PX = (72, 66), (64, 64)
MID_FRAME_CYCLES = 3000
QUIET_CYCLES = 500


@cocotb.test(timeout_time=1, timeout_unit="ms")
async def size_and_mode_written_in_mid_frame(dut: Any) -> None:
    """The running frame is unaffected; the next one is cut from the stream by the new size and mode.

    Among them is one of RGBX pixels, whose X byte is ignored.
    """
    bench = await Bench.open(dut)
    (left, right), (small, _) = render_scene(SIZE_PX, gray=True), render_scene(OTHER_SIZE_PX, gray=True)
    colour, _ = render_scene(OTHER_SIZE_PX, gray=False)
    await bench.configure(left, memory_mode=1)
    await bench.send_memory(left)
    await ClockCycles(dut.aclk, MID_FRAME_CYCLES)
    await bench.configure(small, memory_mode=1)
    await bench.send_memory(small)
    await ClockCycles(dut.aclk, left.size)
    await bench.configure(colour, memory_mode=1)
    await bench.send_memory(colour)
    await ClockCycles(dut.aclk, small.size)
    await bench.configure(right)
    await bench.send_video(right)
    assert_golden(await bench.receive_frames(4), {0: left, 1: small, 2: colour, 3: right})


@cocotb.test(timeout_time=1, timeout_unit="ms")
async def limit_and_reference_written_after_the_last_pixel(dut: Any) -> None:
    """Settings written while a frame is matched, or waits to be, take effect with the next frame."""
    bench = await Bench.open(dut)
    left, right = render_scene(SIZE_PX, gray=True)
    images = {0: left, 1: right, 2: right, 3: right}
    expected = compute_golden(images, "held")
    bench.sinks[MATCHES].pause = True
    await bench.configure(left, memory_mode=1)
    await bench.send_memory(left, right, right)
    await bench.video.wait()
    await ClockCycles(dut.aclk, QUIET_CYCLES)
    await bench.configure(left, reference="previous", memory_mode=1, keep_above=255, take_reference=0)
    bench.sinks[MATCHES].pause = False
    await bench.send_memory(right)
    results = await bench.receive_frames(4)
    assert_golden(results[:3], {number: images[number] for number in range(3)})
    # The last frame alone is matched with the one before it, and keeps nothing.
    last = results[3].match_status
    previous = compute_golden(images, "previous")[3].match_status["matches"]
    assert (last["matches"], last["kept"]) == (previous, 0)
    assert len(expected[3].matches) < last["matches"]


@cocotb.test(timeout_time=3, timeout_unit="ms")
async def impossible_settings_are_refused_and_counted(dut: Any) -> None:
    """Larger than built, or out of range: a bad frame with its cause in either mode; the next valid one is good."""
    bench = await Bench.open(dut)
    left, right = render_scene(OTHER_SIZE_PX, gray=True)
    wide = np.zeros((64, MAX_SIZE_PX[0] + 32), np.uint8)
    in_video: list[tuple[Any, dict[str, int]]] = [(wide, {})]
    in_memory = [
        (left, {"height_px": MAX_SIZE_PX[1] + 1}),
        (left, {"width_px": 0}),
        (left, {"per_cell": 9}),
        (left, {"per_cell": 0}),
        (left, {"cell_log2": 4}),
    ]
    number = bad = 0
    for memory_mode, send, impossible in ((0, bench.send_video, in_video), (1, bench.send_memory, in_memory)):
        for image, values in impossible:
            await bench.configure(image, reference="held", memory_mode=memory_mode, **values)
            await send(image)
            (result,) = await bench.receive_frames(1)
            assert_bad(result, number, Cause.INVALID_SETTINGS)
            number += 1
        await bench.video.wait()
        bad += len(impossible)
        assert await bench.read("bad_frames") == bad
        await bench.configure(left, memory_mode=memory_mode, reference="previous")
        await send(right if memory_mode else left)
        (good,) = await bench.receive_frames(1)
        number += 1
        assert good.status["good"]
        assert not good.status["causes"]
    assert len(good.matches) == compute_golden({0: left, 1: right}, "previous")[1].match_status["matches"]
    assert await bench.read("frames") == number
    assert await bench.read("enable") == RUNNING["enable"]
