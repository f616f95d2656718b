"""A test bench for the exported accelerator: two small frames through its AXI ports."""

import dataclasses

import numpy as np
from numpy.typing import NDArray

from golden_model.arrays import Records
from golden_model.config import MIN_FRAME_PX, Config
from golden_model.front_end import FrameFeatures, extract
from golden_model.matching.matcher import match
from golden_model.records import FRAME_STATUS, WORD_BYTES
from hdl.axi.video_input import pixels_per_clock
from hdl.blocks.testbench import Port, VerilogBench
from hdl.blocks.vectors import Row, packet, padded_status, sample_image
from hdl.export.bus_interfaces import CLOCK, RESET
from hdl.registers.register_map import IDENTITY, REGISTERS, register_writes
from hdl.settings import RUNNING, matched_frame_settings

FRAME_PX = MIN_FRAME_PX
SHIFT_PX = 6
"""Horizontal shift of the second frame."""
_CONTROL = next(register.offset for register in REGISTERS if register.name == "CONTROL")
# Not compared: the golden model has no clock.
_CYCLES_WORD = next(offset for field, offset in FRAME_STATUS.offsets() if field.name == "cycles") // WORD_BYTES


def make_accelerator_bench(module: str, ports: dict[str, Port], config: Config, *, video_bits: int) -> VerilogBench:
    """Make a bench that reads a register, writes the settings, sends two gray frames, and compares all words.

    Parameters
    ----------
    module : str
        The accelerator, with the ports of `hdl.accelerator.AcceleratorTop`.
    ports : dict of str to Port
    config : Config
        The configuration built; the threshold is raised until the features fit.
    video_bits : int
        Width of the video input.
    """
    scene = sample_image(FRAME_PX, FRAME_PX + SHIFT_PX)
    images = [np.ascontiguousarray(scene[:, shift : shift + FRAME_PX]) for shift in (0, SHIFT_PX)]
    config, frames = _extract_good_frames(config, images)
    feature_packets = [_packet(frame.status, frame.features) for frame in frames]
    matches = match(frames[0].features, frames[1].features, config.front_end.pattern, config.matcher)
    counts = {"matches": len(matches), "kept": int(np.count_nonzero(matches["verdict"]))}
    match_packets = [_packet(frames[0].status, matches[:0]), _packet(frames[1].status, matches, **counts)]
    writes = _list_writes(config)
    control = "s_axi_ctrl_"
    return VerilogBench(
        module=module,
        ports=ports,
        inputs={
            f"{control}aw": [{f"{control}awaddr": address, f"{control}awprot": 0} for address, _ in writes],
            f"{control}w": [{f"{control}wdata": word, f"{control}wstrb": 0xF} for _, word in writes],
            f"{control}ar": [{f"{control}araddr": 0, f"{control}arprot": 0}],
            "s_axis_video_t": [beat for image in images for beat in _split_into_beats(image, video_bits)],
        },
        outputs={
            f"{control}b": [{f"{control}bresp": 0}] * len(writes),
            f"{control}r": [{f"{control}rdata": IDENTITY, f"{control}rresp": 0}],
            "m_axis_features_t": _fill_stream("m_axis_features_t", *feature_packets),
            "m_axis_matches_t": _fill_stream("m_axis_matches_t", *match_packets),
        },
        settings={},
        clock=CLOCK,
        reset=RESET,
        reset_level=0,
    )


def _extract_good_frames(config: Config, images: list[NDArray[np.uint8]]) -> tuple[Config, list[FrameFeatures]]:
    """Extract the frames, doubling the threshold until the features of every frame fit the build."""
    front_end = config.front_end.for_size(FRAME_PX, FRAME_PX)
    while True:
        frames = [extract(image, front_end, frame=number) for number, image in enumerate(images)]
        if all(frame.status["good"] for frame in frames):
            return dataclasses.replace(config, preset="any", front_end=front_end), frames
        front_end = dataclasses.replace(front_end, threshold=2 * front_end.threshold)


def _packet(status: np.void, records: Records, **counts: int) -> list[Row]:
    """Make the words of records and of the frame's status, in which ``counts`` are set."""
    return packet(records, padded_status(status, records.dtype.itemsize, **counts), unspecified=(_CYCLES_WORD,))


def _list_writes(config: Config) -> list[tuple[int, int]]:
    """List addresses and words of the settings; CONTROL comes last, because it starts everything."""
    settings = matched_frame_settings(config, FRAME_PX, FRAME_PX, gray_input=True) | RUNNING
    return sorted(register_writes(settings), key=lambda write: write[0] == _CONTROL)


def _split_into_beats(image: NDArray[np.uint8], video_bits: int) -> list[Row]:
    """Split an image into beats of one or two gray pixels; of two, the left one is in the lower half."""
    count = pixels_per_clock(video_bits)
    weights = 1 << np.arange(count) * (video_bits // count)
    beats = image.reshape(len(image), -1, count) @ weights
    return [
        {
            "s_axis_video_tdata": int(beats[y, x]),
            "s_axis_video_tuser": int(x == y == 0),
            "s_axis_video_tlast": int(x == beats.shape[1] - 1),
        }
        for y, x in np.ndindex(*beats.shape)
    ]


def _fill_stream(prefix: str, *packets: list[Row]) -> list[Row]:
    """Turn the words of packets into rows of an AXI4-Stream."""
    return [
        {f"{prefix}keep": 0xFF, **{f"{prefix}{name}": value for name, value in word.items()}}
        for words in packets
        for word in words
    ]
