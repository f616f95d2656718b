"""Vectors of a test bench: the inputs of a block and its expected outputs."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from amaranth.lib import wiring
from numpy.typing import NDArray

from golden_model.records import FRAME_STATUS
from hdl.blocks.flat import flat_values

LICENCE = "Apache-2.0"
Row = dict[str, int]
"""Values of ports by their flat names; unspecified outputs are missing."""


@dataclass(frozen=True)
class Memory:
    """A memory of 64-bit words behind AXI4 ports without IDs; unknown until it is written."""

    base: int
    """Its address."""
    words: Sequence[int]
    bursts: int
    """What it holds in the end, and the bursts that are written until then."""
    writers: Sequence[str]
    readers: Sequence[str]
    """Prefixes of the ports that write and read it."""


@dataclass(frozen=True)
class Block:
    """A block and its vectors."""

    component: wiring.Component
    description: str
    """A sentence for its README."""
    inputs: Mapping[str, Sequence[Row]]
    outputs: Mapping[str, Sequence[Row]]
    """For each stream, beat or channel of AXI (``bus_r``), the inputs and the expected outputs, in order."""
    settings: Mapping[str, int] = field(default_factory=dict)
    """Values of other inputs, which stay."""
    names: Mapping[str, str] = field(default_factory=dict)
    """What ports are called when the block is exported, where not by their flat names."""
    spacing_cycles: int = 1
    """Minimum number of clocks from one input to the next."""
    parameters: Mapping[str, Any] = field(default_factory=dict)
    """What it was built from, by the names of the configuration."""
    memory: Memory | None = None
    start_cycles: int = 0
    """Clocks after which inputs begin."""
    licence: str = LICENCE
    """SPDX identifier; empty for what is not of this project."""
    clocks_each: int | None = None
    """Clocks from one answer to the next of a stream that nobody stalls."""
    idle_cycles: int = 2048
    """Clocks after which a block that does not answer has failed."""
    remembers: bool = False
    """A stream whose packets or bursts count as a whole: all meet gaps and stalls, and its latency is not checked."""
    in_turn: bool = False
    """Each input waits until all of the one before it has gone."""


def rows(name: str, values: Sequence[Any]) -> list[Row]:
    """Convert values of dictionaries and sequences to rows of the stream or beat ``name``."""
    return [flat_values(name, value) for value in values]


def pixel_rows(pixels_per_clock: int = 1, /, **planes: NDArray[Any]) -> list[Row]:
    """Convert a frame to the beats at the port ``i``, in raster order; the last of an odd line repeats its pixel."""
    height, width = next(iter(planes.values())).shape[:2]
    beats: list[dict[str, Any]] = []
    for y, x in np.ndindex(height, -(-width // pixels_per_clock)):
        columns = [min(pixels_per_clock * x + n, width - 1) for n in range(pixels_per_clock)]
        payload = {name: [plane[y, column].tolist() for column in columns] for name, plane in planes.items()}
        if pixels_per_clock == 1:
            payload = {name: pixel for name, (pixel,) in payload.items()}
        beats.append({"x": pixels_per_clock * x, "y": y, **payload})
    return rows("i", beats)


def answer_rows(
    pixels_per_clock: int = 1, /, *, lag_px: int = 0, margin_px: int = 0, **planes: NDArray[Any]
) -> list[Row]:
    """Convert the results for a frame to the beats at the port ``o``.

    Each comes ``lag_px`` to the right of and below its pixel. In the margin, where the block's window leaves the frame,
    outputs are unspecified.
    """
    height, width = next(iter(planes.values())).shape[:2]
    beats: list[Row] = []
    for y, x in np.ndindex(height, -(-width // pixels_per_clock)):
        beats += rows("o", [{"x": pixels_per_clock * x, "y": y}])
        for n in range(pixels_per_clock):
            at = (y - lag_px, pixels_per_clock * x + n - lag_px)
            if all(margin_px <= part < side - margin_px for part, side in zip(at, (height, width), strict=True)):
                port = "o_{}" if pixels_per_clock == 1 else f"o_{{}}_{n}"
                for name, plane in planes.items():
                    beats[-1] |= flat_values(port.format(name), plane[at].tolist())
    return beats


def scan(
    component: Any, about: str, frames: Sequence[Mapping[str, NDArray[Any]]], answer: Callable[..., dict[str, Any]],
    *, margin_px: int = 0, settings: Row | None = None, answered_per_clock: int | None = None,
) -> Block:  # fmt: skip
    """A block that gets frames, pixel by pixel, and answers with what is computed of their planes."""
    rate = getattr(component, "pixels_per_clock", 1)
    places: dict[str, Any] = {"lag_px": getattr(component, "lag_px", 0), "margin_px": margin_px}
    sent = [row for frame in frames for row in pixel_rows(rate, **frame)]
    answered = [row for frame in frames for row in answer_rows(answered_per_clock or rate, **places, **answer(**frame))]
    return Block(component, about, {"i": sent}, {"o": answered}, settings or {})


def of_stream(component: Any, about: str, sent: Sequence[Any], expected: Sequence[Any], **settings: int) -> Block:
    """A block with a stream or a beat ``i`` and ``o``: the payloads that go in, and those that come out."""
    spacing = getattr(component, "spacing_cycles", 1)
    return Block(component, about, {"i": rows("i", sent)}, {"o": rows("o", expected)}, settings, spacing_cycles=spacing)


def neighbours(plane: NDArray[Any]) -> dict[str, NDArray[Any]]:
    """What lies to the left and right of each pixel, above and below it; wrong at the border."""
    sides = {"left": (1, 1), "right": (-1, 1), "up": (1, 0), "down": (-1, 0)}
    return {name: np.roll(plane, *side) for name, side in sides.items()}


def sample_frames() -> list[NDArray[np.uint8]]:
    """Two frames of an odd size: tiles, noise, and the extremes side by side."""
    frames = [sample_image(27, 31, seed) for seed in (3, 4)]
    for seed, frame in enumerate(frames):
        frame[:9, 14:] = np.random.default_rng(seed).integers(0, 256, (9, 17))
        frame[18:, 14:] = np.indices((9, 17)).sum(0) % 2 * 255
    return frames


def sample_image(height: int = 26, width: int = 30, seed: int = 3) -> NDArray[np.uint8]:
    """Make an image with edges and corners everywhere: gray tiles of 5 px with noise."""
    rng = np.random.default_rng(seed)
    tiles = rng.integers(0, 256, (height // 5 + 1, width // 5 + 1))
    image = np.kron(tiles, np.ones((5, 5), int))[:height, :width] + rng.integers(-6, 7, (height, width))
    return np.asarray(image.clip(0, 255), np.uint8)


def packet(*records: NDArray[Any], unspecified: tuple[int, ...] = ()) -> list[dict[str, int]]:
    """Convert records to the words of a packet; ``unspecified`` lists words of the last record to leave out."""
    *words, last = np.frombuffer(b"".join(_clear_padding(record).tobytes() for record in records), np.uint64).tolist()
    packet = [{"data": word, "last": 0} for word in words] + [{"data": last, "last": 1}]
    # A missing field is not compared.
    for word in unspecified:
        del packet[len(packet) - records[-1].itemsize // 8 + word]["data"]
    return packet


def _clear_padding(records: NDArray[Any]) -> NDArray[Any]:
    """Copy records with zeros between their fields, where NumPy leaves whatever was in memory."""
    clean = np.zeros(records.shape, records.dtype)
    for name in records.dtype.names or ():
        clean[name] = records[name]
    return clean


def padded_status(status: np.void, record_bytes: int, **values: int) -> NDArray[Any]:
    """Pad a FrameStatus to the length of the records before it; ``values`` replace some of its fields."""
    padded = np.zeros((), FRAME_STATUS.dtype_padded_to(record_bytes))
    for name in FRAME_STATUS.dtype.names or ():
        padded[name] = values.get(name, status[name])
    return padded
