# amaranth: UnusedElaboratable=no
# What is made and not elaborated would warn whoever refuses it, or looks at its vectors alone.
"""Rows of the blocks at the accelerator's AXI ports."""

from dataclasses import replace
from random import Random
from typing import Any

import numpy as np

from golden_model.records import FRAME_STATUS, MATCH, WORD_BYTES, Tag
from hdl.axi.axi_lite import Response
from hdl.axi.axi_read import BurstReader
from hdl.axi.axi_write import BURST_BYTES, BURST_WORDS, INCREMENTING
from hdl.axi.packet_gate import PacketGate
from hdl.axi.video_input import VideoInput
from hdl.blocks.pixel import BlockConfig
from hdl.blocks.vectors import Block, of_stream, packet, padded_status, rows

BEATS, LINE_BEATS = 40, 8


def make_video_input(config: BlockConfig, *, memory_mode: int = 1, gray: int = 1) -> Block:
    """Make the video input, and beats with any data in all bytes that the port has."""
    block = VideoInput(video_bits=config.video_bits)
    rate, per_beat = block.pixels_per_clock, block.gray_per_beat if memory_mode and gray else 1
    lanes = np.zeros((BEATS, rate, 4), int)
    wired = config.video_bits // (8 * rate)
    # A single pixel always has the 32 bits of a DMA.
    pixel_bytes = 4 if rate == 1 else wired
    lanes[..., :wired] = np.random.default_rng(2).integers(0, 256, (BEATS, rate, wired))
    data = lanes[..., :pixel_bytes].reshape(BEATS, -1) @ (1 << 8 * np.arange(rate * pixel_bytes))
    marks = [{"first": n == 0, "last": n % LINE_BEATS == LINE_BEATS - 1} for n in range(BEATS)]
    # Memory has red, green, blue; video green, blue, red.
    order = [lane for lane in ((1, 2, 0) if memory_mode else (0, 1, 2)) if lane < pixel_bytes]
    colours = lanes[..., order] @ (1 << 8 * np.arange(len(order)))
    pixels = lanes[..., :per_beat].swapaxes(1, 2) if memory_mode and gray else colours[:, np.newaxis]
    answers = [
        {"data": each if rate > 1 else each[0], "first": mark["first"], "last": mark["last"] and n == per_beat - 1}
        for of_beat, mark in zip(pixels.tolist(), marks, strict=True)
        for n, each in enumerate(of_beat)
    ]
    about = "Pixels of AXI4-Stream video, or of the words of a DMA."
    settings = {"i_memory_mode": memory_mode, "i_gray_input": gray, "i_frame_ends": 0}
    sent = [{"data": word, **mark} for word, mark in zip(data.tolist(), marks, strict=True)]
    return of_stream(block, about, sent, answers, **settings)


def make_packet_gate() -> Block:
    """Make the gate of an output, and packets of one to four records that pass."""
    records, status = np.zeros(3, MATCH.dtype), np.zeros(1, FRAME_STATUS.dtype)[0]
    records["tag"], records["distance"], status["tag"] = Tag.MATCH, range(3), Tag.FRAME_STATUS
    words = [word for n in (0, 1, 3, 2) for word in packet(records[:n], padded_status(status, MATCH.record_bytes))]
    about = "Passes or discards whole packets of match records, and completes those that break off."
    gate = PacketGate(record_bytes=MATCH.record_bytes)
    return replace(of_stream(gate, about, words, words, i_enable=1, i_clear=0), remembers=True)


def make_burst_reader() -> Block:
    """Make the reader, and a memory that has a word ready before it is asked, some of them with an error."""
    random, answers, asked = Random(3), list[dict[str, Any]](), list[dict[str, int]]()
    ends = [sorted(random.choices(range(BURST_WORDS), k=2)) for _ in range(20)]
    # The shortest and the longest, one behind the other in the same place, and at both ends of memory.
    parts = [(random.choice((0, 0x2468_ACF0, (1 << 57) - 1)), *each) for each in [[0, 15], [0, 0], [15, 15], *ends]] * 2
    for burst, first, last in parts:
        length, address = last - first + 1, burst * BURST_BYTES + first * WORD_BYTES
        asked.append({"araddr": address, "arlen": length - 1, "arsize": 3, "arburst": INCREMENTING})
        response = random.choice((Response.OKAY, Response.OKAY, Response.SLVERR))
        for n in range(length):
            answers.append({"rdata": random.getrandbits(64), "rresp": response, "rlast": n == length - 1})
    sent = [dict(zip(("burst", "first", "last"), part, strict=True)) for part in parts]
    words = [{"data": word["rdata"], "failed": word["rresp"] != Response.OKAY} for word in answers]
    return Block(
        BurstReader(),
        "Reads bursts of up to 16 words of 64 bits by AXI4.",
        {"i": rows("i", sent), "bus_r": rows("bus", answers)},
        {"o": rows("o", words), "bus_ar": rows("bus", asked)},
        idle_cycles=99,
        remembers=True,
    )
