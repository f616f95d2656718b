"""The bench of a camera build expects the bursts that the ring writer makes."""

import dataclasses

import pytest
from amaranth.hdl import Fragment

from golden_model.config import EstimatorConfig
from hdl.axi.axi_write import BURST_BYTES
from hdl.blocks.export import module_ports
from hdl.blocks.painting import CANVAS_TILES
from hdl.blocks.testbench import VerilogBench
from hdl.build import BUILDS, Build
from hdl.export.camera_bench import RING_ADDRESSES, SLOT_PAGES, make_camera_bench
from hdl.settings import PAGE_BYTES
from hdl.shell.camera_top import CameraTop
from hdl.shell.slot import HEADER_BYTES

BUILD = Build(config=BUILDS["tiny"].config, lanes=2, max_width_px=128, max_height_px=128, video_bits=8, shell="camera")


@pytest.fixture(scope="module")
def bench() -> VerilogBench:
    top = CameraTop(BUILD)
    # Amaranth warns of a component that nothing elaborates.
    Fragment.get(top, None)
    return make_camera_bench("camera", module_ports(top), BUILD)


@pytest.mark.parametrize("ring", ["features", "matches"])
def test_a_packet_is_written_behind_the_header_of_its_slot_which_comes_last(bench: VerilogBench, ring: str) -> None:
    addresses = [row[f"m_axi_{ring}_awaddr"] for row in bench.outputs[f"m_axi_{ring}_aw"]]
    slots = [RING_ADDRESSES[ring] + number * SLOT_PAGES * PAGE_BYTES for number in (0, 1)]
    ends = [addresses.index(slot) + 1 for slot in slots]
    assert ends[1] == len(addresses)
    for slot, (begin, end) in zip(slots, ((0, ends[0]), (ends[0], ends[1])), strict=True):
        data = addresses[begin : end - 1]
        assert data == list(range(slot + HEADER_BYTES, slot + HEADER_BYTES + len(data) * BURST_BYTES, BURST_BYTES))


def test_the_camera_waits_for_the_settings(bench: VerilogBench) -> None:
    assert bench.clocks == {"s_axis_video_t": "video_aclk"}
    assert bench.conditions["s_axis_video_t"] == f"s_axi_ctrl_b_next == {len(bench.inputs['s_axi_ctrl_w'])}"


def test_both_frames_are_painted_and_lie_in_memory() -> None:
    build = dataclasses.replace(
        BUILD, config=dataclasses.replace(BUILD.config, estimator=EstimatorConfig()), painter=True
    )
    memory = make_camera_bench("camera", {}, build).memory
    assert memory
    tiles = CANVAS_TILES**2
    # Twice all tiles, and 64 lines of 256 bytes.
    assert memory.bursts == 2 * tiles * 32 + 2 * 64 * 2
    assert len(memory.words) == (tiles * PAGE_BYTES + 2 * 64 * 64 * 4) // 8
    assert [len(memory.writers), len(memory.readers)] == [2, 3]
