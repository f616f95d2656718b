"""A test bench for the exported camera build: a camera's frames into rings in memory."""

import numpy as np

from golden_model.records import WORD_BYTES
from hdl.axi.axi_write import BURST_BYTES, BURST_WORDS, INCREMENTING, MODIFIABLE
from hdl.blocks.testbench import Port, VerilogBench
from hdl.blocks.vectors import Row
from hdl.build import Build
from hdl.export.accelerator_bench import (
    VIDEO_STREAM,
    SampleFrames,
    control_inputs,
    control_outputs,
    list_writes,
)  # fmt: skip
from hdl.export.ip_xact import CLOCK, RESET
from hdl.settings import MIN_SLOTS, PAGE_BYTES
from hdl.shell.painting import PORTS
from hdl.shell.slot import HEADER, HEADER_BYTES

RING_ADDRESSES = {"features": 0x1000_0000, "matches": 0x2000_0000, "homographies": 0x3000_0000}
SLOT_PAGES = 256


def make_camera_bench(module: str, ports: dict[str, Port], build: Build) -> VerilogBench:
    """Make a bench for `hdl.shell.camera_top.CameraTop`: both frames come from a camera with a clock of its own.

    It compares every burst that is written into the rings, and answers them. A painter stays off.
    """
    frames = SampleFrames(build.config)
    rings = {
        f"{ring}_{name}": value
        for ring in frames.packets
        for name, value in (("base_low", RING_ADDRESSES[ring]), ("slots", MIN_SLOTS), ("slot_pages", SLOT_PAGES))
    }
    writes = list_writes(frames.config, **rings)
    words = build.record_words
    bursts = {f"m_axi_{ring}_": _write_bursts(ring, sent, words[ring]) for ring, sent in frames.packets.items()}
    return VerilogBench(
        module=module,
        ports=ports,
        inputs={
            **control_inputs(writes),
            VIDEO_STREAM: frames.beats(build.video_bits),
            **{f"{prefix}b": [{f"{prefix}bresp": 0}] * len(addresses) for prefix, (addresses, _) in bursts.items()},
        },
        outputs={
            **control_outputs(writes),
            **{f"{prefix}aw": addresses for prefix, (addresses, _) in bursts.items()},
            **{f"{prefix}w": words for prefix, (_, words) in bursts.items()},
        },
        settings={
            name: 0
            for painters in PORTS
            for name, port in ports.items()
            if port.is_input and name.startswith(f"m_axi_{painters}_")
        },
        clocks={VIDEO_STREAM: "video_aclk"},
        conditions={
            # A camera does not wait until the accelerator is switched on.
            VIDEO_STREAM: f"s_axi_ctrl_b_next == {len(writes)}",
            **{
                f"{prefix}b": f"{prefix}b_next < {prefix}aw_next"
                f" && {BURST_WORDS} * {prefix}b_next + {BURST_WORDS} <= {prefix}w_next"
                for prefix in bursts
            },
        },
        clock=CLOCK,
        reset=RESET,
        reset_level=0,
    )


def _write_bursts(ring: str, packets: list[list[Row]], record_words: int) -> tuple[list[Row], list[Row]]:
    """The addresses of the bursts that write packets into a ring, and their words (`hdl.shell.ring_writer`)."""
    prefix = f"m_axi_{ring}_"
    same = {"awlen": BURST_WORDS - 1, "awsize": 3, "awburst": INCREMENTING, "awcache": MODIFIABLE, "awprot": 0}
    addresses, words = [], []
    for number, sent in enumerate(packets):
        slot = RING_ADDRESSES[ring] + number * SLOT_PAGES * PAGE_BYTES
        offsets = [*range(HEADER_BYTES, HEADER_BYTES + len(sent) * WORD_BYTES, BURST_BYTES), 0]
        addresses += [{"awaddr": slot + offset, **same} for offset in offsets]
        for burst in (sent, _header(number + 1, sent, record_words)):
            words += [{"wstrb": 0xFF, **({"wdata": word["data"]} if "data" in word else {})} for word in burst]
            words += [{"wstrb": 0, "wdata": 0}] * (-len(burst) % BURST_WORDS)
    for number, word in enumerate(words):
        words[number] = {**word, "wlast": int(number % BURST_WORDS == BURST_WORDS - 1)}
    named = [[{f"{prefix}{name}": value for name, value in row.items()} for row in rows] for rows in (addresses, words)]
    return named[0], named[1]


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
