"""A test bench for the exported camera build: a camera's frames into rings in memory."""

from dataclasses import replace

import numpy as np

from golden_model.painting.pose import Placement, placement_of
from golden_model.records import WORD_BYTES
from hdl.axi.axi_write import BURST_BYTES, BURST_WORDS, INCREMENTING, MODIFIABLE
from hdl.blocks.painting import CANVAS_TILES, CLEARING_CYCLES, FIRST_POSE, FRAMES_ADDRESS, MEMORY_ADDRESS, paint
from hdl.blocks.testbench import Port, VerilogBench
from hdl.blocks.vectors import Memory, Row
from hdl.build import Build
from hdl.export.accelerator_bench import BUS, FRAME_PX, VIDEO_STREAM, SampleFrames, control_streams, list_writes, named
from hdl.export.ip_xact import CLOCK, RESET
from hdl.painting.frame_writer import frame_pages
from hdl.settings import MIN_SLOTS, PAGE_BYTES, POSE_ELEMENTS
from hdl.shell.slot import HEADER, HEADER_BYTES

RING_ADDRESSES = {"features": 0x1000_0000, "matches": 0x2000_0000, "homographies": 0x3000_0000}
SLOT_PAGES = 256
PAINTER_SETTINGS = {
    "canvas_base_low": MEMORY_ADDRESS,
    "canvas_columns": CANVAS_TILES,
    "canvas_rows": CANVAS_TILES,
    "frames_base_low": FRAMES_ADDRESS,
    "frames_buffer_pages": frame_pages(FRAME_PX, FRAME_PX),
    "painter_enable": 1,
    **{name: value & 0xFFFF_FFFF for name, value in zip(POSE_ELEMENTS, FIRST_POSE.ravel().tolist(), strict=True)},
    "pose_set": 1,
}


def make_camera_bench(module: str, ports: dict[str, Port], build: Build) -> VerilogBench:
    """Make a bench for `hdl.shell.camera_top.CameraTop`: both frames come from a camera with a clock of its own.

    It compares every burst that is written into the rings, and answers them. A painter has a memory, of which canvas
    and frames are compared in the end; the first frame's pose is the host's, the second's follows from the homography.
    """
    frames = SampleFrames(build.config)
    rings = {
        f"{ring}_{name}": value
        for ring in frames.packets
        for name, value in (("base_low", RING_ADDRESSES[ring]), ("slots", MIN_SLOTS), ("slot_pages", SLOT_PAGES))
    }
    writes = list_writes(frames.config, **rings, **(PAINTER_SETTINGS if build.painter else {}))
    inputs, outputs = control_streams(writes)
    conditions = {
        # A camera does not wait until the accelerator is switched on.
        VIDEO_STREAM: f"{BUS}b_next == {len(writes)}",
        f"{BUS}aw": f"cycle > {CLEARING_CYCLES}" if build.painter else "1",
    }
    for ring, packets in frames.packets.items():
        prefix = f"m_axi_{ring}_"
        addresses, words = _write_bursts(ring, packets, build.record_words[ring])
        outputs |= {f"{prefix}aw": named(prefix, addresses), f"{prefix}w": named(prefix, words)}
        inputs[f"{prefix}b"] = [{f"{prefix}bresp": 0}] * len(addresses)
        sent = f"{BURST_WORDS} * {prefix}b_next + {BURST_WORDS} <= {prefix}w_next"
        conditions[f"{prefix}b"] = f"{prefix}b_next < {prefix}aw_next && {sent}"
    return VerilogBench(
        module=module,
        ports=ports,
        inputs={**inputs, VIDEO_STREAM: frames.beats(build.video_bits)},
        outputs=outputs,
        clocks={VIDEO_STREAM: "video_aclk"},
        conditions=conditions,
        # Nothing is shown; a display would take it.
        settings={"m_axis_picture_tready": 1} if build.painter else {},
        memory=_paint(frames) if build.painter else None,
        clock=CLOCK,
        reset=RESET,
        reset_level=0,
    )


def _paint(frames: SampleFrames) -> Memory:
    """The painter's memory when both frames have been painted."""
    colours = [np.repeat(image[..., np.newaxis], 3, axis=-1) for image in frames.images]
    first = Placement(0, 0, FIRST_POSE, composed=False)
    _, memory = paint(colours, (first, placement_of(frames.homographies[1][0])), "m_axi_")
    return replace(memory, readers=(*memory.readers, "m_axi_pictures_"))


def _write_bursts(ring: str, packets: list[list[Row]], record_words: int) -> tuple[list[Row], list[Row]]:
    """The addresses of the bursts that write packets into a ring, and their words (`hdl.shell.ring_writer`)."""
    same = {"awlen": BURST_WORDS - 1, "awsize": 3, "awburst": INCREMENTING, "awcache": MODIFIABLE, "awprot": 0}
    addresses, words = [], []
    for number, sent in enumerate(packets):
        slot = RING_ADDRESSES[ring] + number * SLOT_PAGES * PAGE_BYTES
        offsets = [*range(HEADER_BYTES, HEADER_BYTES + len(sent) * WORD_BYTES, BURST_BYTES), 0]
        addresses += [{"awaddr": slot + offset, **same} for offset in offsets]
        for burst in (sent, _header(number + 1, sent, record_words)):
            words += [{"wstrb": 0xFF, **({"wdata": word["data"]} if "data" in word else {})} for word in burst]
            words += [{"wstrb": 0, "wdata": 0}] * (-len(burst) % BURST_WORDS)
    return addresses, [{**word, "wlast": int(n % BURST_WORDS == BURST_WORDS - 1)} for n, word in enumerate(words)]


def _header(number: int, sent: list[Row], record_words: int) -> list[Row]:
    """The words of a slot's header, without the times."""
    header = np.zeros((), HEADER)
    header["sequence"] = header["number"] = number
    header["length_bytes"] = len(sent) * WORD_BYTES
    header["status"] = sent[-record_words]["data"]
    words: list[Row] = [{"data": word} for word in np.frombuffer(header.tobytes(), np.uint64).tolist()]
    assert HEADER.fields is not None
    for name in ("time", "clocks"):
        words[HEADER.fields[name][1] // WORD_BYTES] = {}
    return words
