# amaranth: UnusedElaboratable=no
"""Colours and weights equal the golden model wherever a window lies, and while the other one is written."""

import itertools
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from golden_model.arrays import Pixels
from golden_model.painting.positions import POSITION
from golden_model.painting.sampling import sample
from hdl.blocks.vectors import Block, rows
from hdl.painting.sampling import Sampling
from tests.hdl.rows import row_test

COUNT = 80
BOXES = {
    # Size of the frame; left, top, right, bottom of the window.
    "a whole frame of odd size": ((45, 37), (0, 0, 44, 36)),
    "the largest width of two windows, across a multiple of 128": ((640, 480), (301, 237, 364, 278)),
    "a wide window at the right border": ((639, 480), (511, 187, 638, 199)),
    "the last corner of the largest frame": ((4096, 4096), (4063, 4070, 4095, 4095)),
    "the largest weights of 1080 lines": ((1920, 1080), (950, 530, 970, 550)),
    "a column at the right border": ((1031, 1100), (1029, 600, 1030, 640)),
}


def draw(size: tuple[int, int], box: tuple[int, int, int, int], seed: int) -> tuple[Pixels, NDArray[np.int64]]:
    """The frame's pixels in the box, and positions in it and, beyond the border of the frame, around it."""
    rng = np.random.default_rng(seed)
    left, top, right, bottom = np.array(box)
    colours = rng.integers(0, 256, (bottom - top + 1, right - left + 1, 3), dtype=np.uint8)
    colours[rng.random(colours.shape) < 0.3] = 255
    colours[rng.random(colours.shape) < 0.3] = 0
    least = np.where([left == 0, top == 0], -5, [left, top])
    most = np.where([right == size[0] - 1, bottom == size[1] - 1], [right + 5, bottom + 5], [right, bottom])
    at = rng.integers(least * POSITION.one, most * POSITION.one, (COUNT, 2))
    # Whole pixels and the last step before the next one.
    at[::4] &= -POSITION.one
    at[1::4] |= POSITION.one - 1
    return colours, at


def expected(size: tuple[int, int], box: tuple[int, int, int, int], colours: Pixels, at: NDArray[np.int64]) -> Any:
    """Colours and weights of the golden model; of the frame only the pixels in the box are made."""
    left, top, right, bottom = box
    frame = np.lib.stride_tricks.as_strided(np.zeros(3, np.uint8), (size[1], size[0], 3), (0, 0, 1))
    _, weights = sample(frame, at)
    part = np.zeros((size[1], right - left + 3, 3), np.uint8)
    part[top : bottom + 1, : right - left + 1] = colours
    inside, _ = sample(part, at - (left * POSITION.one, 0))
    return np.where(weights[:, None] > 0, inside, 0), weights


def sampled(name: str, *, blank: bool = False) -> Block:
    """The box is written in words of two pixels, as they come from memory, and then asked for."""
    size, box = BOXES[name]
    left, top, right, bottom = box
    colours, at = draw(size, box, seed=len(name))
    wide, words = right - left >= 64, list[dict[str, Any]]()
    for y, x in itertools.product(range(top, bottom + 1), range(left & ~1, right + 1, 2)):
        kept = [left <= each <= right for each in (x, x + 1)]
        pair = [colours[y - top, each - left].tolist() if left <= each <= right else [170] * 3 for each in (x, x + 1)]
        words.append({"y": y % 128, "x": x // 2 % 64 if wide else x // 2 % 32 + 32, "pixels": pair, "kept": kept})
    asked = [{"x": x, "y": y, "window": 1, "wide": wide, "blank": blank} for x, y in at.tolist()]
    found, weights = expected(size, box, colours, at)
    assert len(set(weights > 0)) == 2 or name.startswith("the largest")
    answers: list[dict[str, Any]] = [
        {"colour": colour.tolist(), "weight": int(weight)} if weight and not blank else {"weight": 0}
        for colour, weight in zip(found, weights, strict=True)
    ]
    return Block(
        Sampling(),
        "",
        {"i_write": rows("i_write", words), "i": rows("i", asked)},
        {"o": rows("o", answers)},
        dict(zip(("i_width_px", "i_height_px"), size, strict=True)),
        in_turn=True,
    )


FIRST, *_ = BOXES
test_rows = row_test({"blank": partial(sampled, FIRST, blank=True), **{name: partial(sampled, name) for name in BOXES}})
