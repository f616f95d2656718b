"""A test bench for the exported accelerator: two small frames through its AXI ports."""

import dataclasses
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from golden_model.arrays import Records
from golden_model.config import MIN_FRAME_PX, Config, EstimatorConfig
from golden_model.front_end import FrameFeatures, extract
from golden_model.geometry.estimator import frame_homography
from golden_model.matching.matcher import match
from golden_model.records import FRAME_STATUS, WORD_BYTES
from hdl.blocks.testbench import Port, VerilogBench
from hdl.blocks.vectors import Row, packet, padded_status, sample_image
from hdl.build import Build, pixels_per_clock
from hdl.export.ip_xact import CLOCK, RESET
from hdl.registers.register_map import IDENTITY, register_writes
from hdl.registers.shell_register_map import ALL_REGISTERS
from hdl.settings import RUNNING, estimator_settings, matched_frame_settings

FRAME_PX = MIN_FRAME_PX
SHIFT_PX = 6
"""Horizontal shift of the second frame."""
_STARTS = [each.offset for name in ("PAINTER", "POSE_SET", "CONTROL") for each in ALL_REGISTERS if each.name == name]
"""Registers that start something, in the order in which they are written, behind all others."""
# Not compared: the golden model has no clock.
BUS, VIDEO_STREAM = "s_axi_ctrl_", "s_axis_video_t"
_CYCLES_WORD = next(offset for field, offset in FRAME_STATUS.offsets() if field.name == "cycles") // WORD_BYTES


def make_accelerator_bench(module: str, ports: dict[str, Port], build: Build) -> VerilogBench:
    """Make a bench that reads a register, writes the settings, sends two gray frames, and compares all words.

    The module has the ports of `hdl.accelerator.AcceleratorTop`. The threshold of the build's configuration is raised
    until the features fit.
    """
    frames = SampleFrames(build.config)
    inputs, outputs = control_streams(list_writes(frames.config))
    for name, (first, second) in frames.packets.items():
        outputs[f"m_axis_{name}_t"] = named(f"m_axis_{name}_t", ({"keep": 0xFF, **word} for word in first + second))
    return VerilogBench(
        module=module,
        ports=ports,
        inputs={**inputs, VIDEO_STREAM: frames.beats(build.video_bits)},
        outputs=outputs,
        clock=CLOCK,
        reset=RESET,
        reset_level=0,
    )


class SampleFrames:
    """Two frames that move by `SHIFT_PX`, and the packets that they make, by the name of their output."""

    def __init__(self, config: Config) -> None:
        scene = sample_image(FRAME_PX, FRAME_PX + SHIFT_PX)
        self.images = [np.ascontiguousarray(scene[:, shift : shift + FRAME_PX]) for shift in (0, SHIFT_PX)]
        self.config, frames = _extract_good_frames(config, self.images)
        self.matches = match(frames[0].features, frames[1].features, self.config.front_end.pattern, self.config.matcher)
        self.statuses = [frame.status for frame in frames]
        counts = {"matches": len(self.matches), "kept": int(np.count_nonzero(self.matches["verdict"]))}
        self.packets = {
            "features": [_packet(frame.status, frame.features) for frame in frames],
            "matches": [_packet(self.statuses[0], self.matches[:0]), _packet(self.statuses[1], self.matches, **counts)],
        }
        if config.estimator:
            # So few passes that a slow simulator ends, too; their clocks are known, and compared.
            estimator = EstimatorConfig(passes=1, min_inliers=4, min_cells=1)
            self.config = dataclasses.replace(self.config, estimator=estimator)
            sent = zip((self.matches[:0], self.matches), self.statuses, strict=True)
            self.homographies = [frame_homography(matches, status, self.config) for matches, status in sent]
            self.packets["homographies"] = [packet(record) for record in self.homographies]

    def beats(self, video_bits: int) -> list[Row]:
        """The pixels of both frames."""
        return named(VIDEO_STREAM, [beat for each in self.images for beat in _split_into_beats(each, video_bits)])


def named(prefix: str, rows: Iterable[Row]) -> list[Row]:
    """Rows with the names of the ports of a stream."""
    return [{f"{prefix}{name}": value for name, value in row.items()} for row in rows]


def control_streams(writes: list[tuple[int, int]]) -> tuple[dict[str, list[Row]], dict[str, list[Row]]]:
    """A read of the first register and the writes; and the answers to them."""
    sent = {
        "aw": [{"awaddr": address, "awprot": 0} for address, _ in writes],
        "w": [{"wdata": word, "wstrb": 0xF} for _, word in writes],
        "ar": [{"araddr": 0, "arprot": 0}],
    }
    answers = {"b": [{"bresp": 0}] * len(writes), "r": [{"rdata": IDENTITY, "rresp": 0}]}
    inputs, outputs = ({BUS + name: named(BUS, rows) for name, rows in each.items()} for each in (sent, answers))
    return inputs, outputs


def _extract_good_frames(config: Config, images: list[NDArray[np.uint8]]) -> tuple[Config, list[FrameFeatures]]:
    """Extract the frames, doubling the threshold until the features of every frame fit the build."""
    front_end = config.front_end.for_size(FRAME_PX, FRAME_PX)
    while True:
        frames = [extract(image, front_end, frame=number) for number, image in enumerate(images)]
        if all(frame.status["good"] for frame in frames):
            return dataclasses.replace(config, front_end=front_end), frames
        front_end = dataclasses.replace(front_end, threshold=2 * front_end.threshold)


def _packet(status: np.void, records: Records, **counts: int) -> list[Row]:
    """Make the words of records and of the frame's status, in which ``counts`` are set."""
    return packet(records, padded_status(status, records.dtype.itemsize, **counts), unspecified=(_CYCLES_WORD,))


def list_writes(config: Config, **others: int) -> list[tuple[int, int]]:
    """List addresses and words of the settings and of ``others``; CONTROL comes last, because it starts the frames."""
    settings = matched_frame_settings(config, FRAME_PX, FRAME_PX, gray_input=True) | RUNNING
    settings |= estimator_settings(config) | others
    writes = register_writes(settings, registers=ALL_REGISTERS)
    return sorted(writes, key=lambda write: _STARTS.index(write[0]) if write[0] in _STARTS else -1)


def _split_into_beats(image: NDArray[np.uint8], video_bits: int) -> list[Row]:
    """Split an image into beats of one or two gray pixels; of two, the left one is in the lower half."""
    count = pixels_per_clock(video_bits)
    weights = 1 << np.arange(count) * (video_bits // count)
    beats = image.reshape(len(image), -1, count) @ weights
    height, width = beats.shape
    places = np.ndindex(height, width)
    return [{"data": int(beats[y, x]), "user": int(x == y == 0), "last": int(x == width - 1)} for y, x in places]
