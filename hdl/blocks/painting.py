# amaranth: UnusedElaboratable=no
# What is made and not elaborated would warn whoever refuses it, or looks at its vectors alone.
"""The painter as a block: two frames, the memory around it, and what that holds when both have been painted."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from golden_model.painting import painter as golden
from golden_model.painting.line_reader import bursts, show
from golden_model.painting.pose import MAX_LINKS, Placement, Poses
from golden_model.painting.tiles import MAX_TILES, TILE_PX
from hdl.axi.axi_write import BURST_BYTES
from hdl.blocks.vectors import Block, Memory, rows, sample_image
from hdl.painting.canvas_port import HOLDS, TILE_BURSTS
from hdl.painting.frame_writer import frame_pages
from hdl.painting.line_reader import LineReader
from hdl.painting.painter import Painter
from hdl.settings import PAGE_BYTES

MEMORY_ADDRESS = 0x4000_0000
"""Here lies the canvas, and behind it the frames."""
CANVAS_TILES = 3
"""Its columns, and its rows."""
FRAMES_ADDRESS = MEMORY_ADDRESS + CANVAS_TILES**2 * PAGE_BYTES
FIRST_POSE = np.array([[0xFFFFFF, 0x50000, -0x14000], [-0x50000, 0xFFFFFF, -0xA000], [0, 0, 0xFFFFFF]])
"""A turned frame, 20 px from the canvas's left border and 10 px from the upper one."""
CLEARING_CYCLES = MAX_TILES**2 + 99
"""After a reset the painter forgets its canvas."""
FRAME_PX = 64


def paint(
    frames: Sequence[NDArray[np.uint8]], placements: Sequence[Placement | None], prefix: str = ""
) -> tuple[list[golden.Counts], Memory]:
    """Paint frames (H, W, 3) that fill their rows in memory; those of which nothing says where are only stored.

    The ports of the memory begin with ``prefix``.
    """
    painter, poses = golden.Painter(CANVAS_TILES, CANVAS_TILES), Poses()
    found = [poses.place(each)[0] if each else None for each in placements]
    counts = [painter.paint(frame, pose) for frame, pose in zip(frames, found, strict=True) if pose is not None]
    stored = np.pad(frames, ((0, 0), (0, 0), (0, 0), (0, 1)))
    return counts, Memory(
        MEMORY_ADDRESS,
        np.concatenate([painter.memory.ravel(), stored.ravel()]).view(np.uint64).tolist(),
        bursts=sum(each.painted for each in counts) * TILE_BURSTS + stored.nbytes // BURST_BYTES,
        writers=(f"{prefix}frames_", f"{prefix}new_tiles_"),
        readers=(f"{prefix}windows_", f"{prefix}old_tiles_"),
    )


def make_painter() -> Block:
    """Make the painter: the host says where the first frame is, and a homography where the second."""
    colours = [np.stack([sample_image(FRAME_PX, FRAME_PX, seed + n) for n in range(3)], axis=-1) for seed in (3, 6)]
    step = np.array([[0xFFFFFF, 0x8000, 0x9000], [-0x8000, 0xFFFFFF, -0x5000], [0, 0, 0xFFFFFF]])
    placements = [Placement(1, 1, FIRST_POSE, composed=False), Placement(2, 1, step, composed=True)]
    counts, memory = paint(colours, placements)
    # Green in the lowest byte, then blue, red: the order of UG934.
    pixels = np.stack(colours).astype(int) @ (1 << 8, 1, 1 << 16)
    video = [
        {"data": pixel, "first": x == y == 0, "last": x == FRAME_PX - 1} for (_, y, x), pixel in np.ndenumerate(pixels)
    ]
    poses = [{**vars(each), "elements": each.elements.ravel().tolist()} for each in placements]
    painted = [
        {"frame": n, "counts": {**vars(each), "failed": 0, "has_errors": 0}} for n, each in enumerate(counts, start=1)
    ]
    settings = {
        "enable": 1, "replace": 0, "clear": 0, "nowhere_valid": 0, "nowhere_frame": 0, "max_links": MAX_LINKS,
        **{f"holds_{n}_{name}": 0 for n in range(HOLDS.length) for name in ("valid", "row")},
        "width_px": FRAME_PX, "height_px": FRAME_PX, "columns": CANVAS_TILES, "rows": CANVAS_TILES,
        "canvas_page": MEMORY_ADDRESS // PAGE_BYTES, "frames_page": FRAMES_ADDRESS // PAGE_BYTES,
        "buffer_pages": frame_pages(FRAME_PX, FRAME_PX),
    }  # fmt: skip
    return Block(
        Painter(),
        "Paints each frame of a camera that has a pose onto a canvas in memory.",
        {"i": rows("i", video), "i_poses": rows("i_poses", poses)},
        {"o": rows("o", painted)},
        {f"i_{name}": value for name, value in settings.items()},
        memory=memory,
        start_cycles=CLEARING_CYCLES,
    )


def make_line_reader() -> Block:
    """Make the reader in lines: part of a canvas of odd sides, with holes and with words that could not be read."""
    columns, lines, border, page = 3, 45, 0x123456, 0x8_1234_5678
    rng = np.random.default_rng(2)
    tiles = rng.integers(0, 256, (2, columns, TILE_PX, TILE_PX, 4), np.uint8)
    tiles[..., 3] *= rng.random(tiles.shape[:-1]) < 0.7
    order = bursts(columns, lines)
    words = tiles.reshape(-1, 16 * 8).view(np.uint64)[order]
    failed = rng.random(words.shape) < 0.1
    tiles.reshape(-1, 16, 2, 4)[order, ..., 3] *= ~failed[..., np.newaxis]
    read = [{"data": int(word), "failed": int(bad)} for word, bad in zip(words.flat, failed.flat, strict=True)]
    shown = [
        {"data": int(colour), "first": y + x == 0, "last": x == columns * TILE_PX - 1}
        for (y, x), colour in np.ndenumerate(show(tiles, lines, border))
    ]
    asked = [{"burst": page * TILE_PX + int(each), "first": 0, "last": 15} for each in order]
    return Block(
        LineReader(),
        "Reads the painter's canvas in lines, as AXI4-Stream video for a display.",
        {"i": rows("i", [{"columns": columns, "lines": lines, "border": border}]), "i_words": rows("i_words", read)},
        {"o": rows("o", shown), "o_bursts": rows("o_bursts", asked)},
        {"i_page": page, "i_held": 1, "i_stop": 0},
        clocks_each=1,
    )
