"""What the painter asks of a Zynq's memory, on paper.

    python -m bench.painter_memory

Counted by the golden model for a frame that is turned by 20° and lies on a canvas where all its tiles are painted
already: the camera writes it, windows and old tiles are read, new tiles are written. Packets of the rings come on top,
at most 0.2 MB. A bus of 16 bits is that of PYNQ-Z2 and Arty Z7, with DDR3 at 1,050 transfers per microsecond; 32 bits
are those of Zybo Z7, at 1,066. Half of its peak is left to the painter: the rest goes into opening rows, turning the
bus round and refreshing, and to the processor.
"""

import math

import numpy as np
import typer

from bench.painter import fit_canvas, fly
from bench.painter_zooms import pose_of
from bench.report import JsonFile, Row, report
from golden_model.painting import windows
from golden_model.painting.corners import project
from golden_model.painting.tiles import touched
from hdl.painting.frame_writer import BUFFERS, frame_pages
from hdl.settings import PAGE_BYTES

PEAK_MB_PER_S = {16: 2 * 1050, 32: 4 * 1066}
USABLE = 0.5
MAX_CANVAS_PX = 4096
VIDEOS = {(640, 480): 60, (1280, 720): 60, (1920, 1080): 30}
"""Frames per second of a camera, by its size."""
WORD_BYTES, WORD_PX = 8, 2


def main(json_file: JsonFile = None) -> None:
    """Compute."""
    rows: list[Row] = []
    for size, rate in VIDEOS.items():
        frame_mb = count_bytes(size) / 1e6
        most = {bits: math.floor(USABLE * peak / frame_mb) for bits, peak in PEAK_MB_PER_S.items()}
        buffers_bytes = BUFFERS * frame_pages(*size) * PAGE_BYTES
        row: Row = {
            "frames": f"{size[0]}×{size[1]}",
            "three buffers (MB)": round(buffers_bytes / 1e6, 1),
            "largest canvas (MB)": round(4 * MAX_CANVAS_PX**2 / 1e6, 1),
            "traffic per frame (MB)": round(frame_mb, 1),
            "frames per second": rate,
            "MB/s": round(rate * frame_mb),
        }
        rows.append(row | {f"at most, with {bits} bits": fastest for bits, fastest in most.items()})
    report("The painter's memory, on paper", rows, json_file)


def count_bytes(size: tuple[int, int]) -> int:
    """Bytes that cross the memory's bus for a frame."""
    flight = fly(size, 1, shake=1)
    move, tiles = fit_canvas(flight)
    pose = pose_of(flight.homographies[0] @ move)
    corners, _ = project(pose, touched(pose, size, tiles))
    boxes = windows.bounding_boxes(corners)
    boxes = boxes[windows.can_win(boxes, *size, np.zeros(len(boxes), np.int64))]
    left, top, right, bottom = windows.cut_to_frame(boxes, *size).T
    words = (right // WORD_PX - left // WORD_PX + 1) * (bottom - top + 1)
    return frame_pages(*size) * PAGE_BYTES + int(words.sum()) * WORD_BYTES + 2 * len(boxes) * PAGE_BYTES


if __name__ == "__main__":
    typer.run(main)
