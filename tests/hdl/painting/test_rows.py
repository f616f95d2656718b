# amaranth: UnusedElaboratable=no
"""Blending, positions and the reader in lines answer as the golden model, one pixel per clock."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from golden_model.painting.blending import FADE, blend
from golden_model.painting.corners import CORNER
from golden_model.painting.line_reader import bursts, show
from golden_model.painting.positions import positions
from golden_model.painting.tiles import TILE_PX
from hdl.blocks.vectors import Block, of_stream, rows
from hdl.painting.blending import Blending
from hdl.painting.line_reader import LineReader
from hdl.painting.positions import Positions
from sim.benches.rows import Row, check
from tests.golden_model.painting import tilted
from tests.hdl.painting.payloads import corner_payload, pixel_payload
from tests.hdl.rows import table

COUNT = 600


def pixels() -> tuple[NDArray[np.uint8], NDArray[np.int64], NDArray[np.int64]]:
    """Old pixels, colours and weights: extreme and random colours, weights near each other, equal, 0 and 255."""
    rng = np.random.default_rng(1)
    old = rng.integers(0, 256, (COUNT, 4), dtype=np.uint8)
    colours = rng.integers(0, 256, (COUNT, 3))
    old[::5, :3], colours[::3] = 255 * (rng.random((COUNT // 5, 3)) < 0.5), rng.choice([0, 255], (COUNT // 3, 3))
    weights = np.clip(old[:, 3].astype(int) + rng.integers(-FADE, FADE + 1, COUNT), 0, 255)
    weights[::7], old[::11, 3] = rng.integers(0, 256, len(weights[::7])), 0
    weights[::13], weights[::17], old[::19, 3] = 0, 255, 1
    return old, colours, weights


def blending() -> Block:
    old, colours, weights = pixels()
    shares = np.clip(weights - old[:, 3] + FADE // 2, 0, FADE)[old[:, 3] > 0]
    assert set(shares) == set(range(FADE + 1))
    each = zip(old, colours, weights, strict=True)
    sent = [{"old": pixel_payload(under[:3], under[3]), "new": pixel_payload(over, now)} for under, over, now in each]
    answers = [pixel_payload(pixel[:3], pixel[3]) for pixel in blend(old, colours, weights)]
    return of_stream(Blending(), "", sent, answers)


def places() -> Block:
    """Level and tilted tiles, half outside the frame, and corners as far apart as a window allows."""
    rng = np.random.default_rng(1)
    corners = np.concatenate([
        tilted.corners(tilted.pose((640, 480), zoom=0.5, turn=2.0, tilt=8e-4), np.array([[0, 0]])),
        tilted.corners(tilted.pose((100, 90), zoom=1.3, turn=0.7), np.array([[7, 3]])),
        # Whatever the corners, the adders follow: beyond the borders of the largest frame.
        *(rng.integers(0, 127 * CORNER.one, (1, 3, 3, 2)) + first * CORNER.one for first in (-60, 4090)),
    ])  # fmt: skip
    flags = [{"window": n % 2, "wide": n // 2 % 2, "blank": n // 3} for n in range(len(corners))]
    sent = [{"corners": corner_payload(each), **of_tile} for each, of_tile in zip(corners, flags, strict=True)]
    found = positions(corners).reshape(len(corners), -1, 2).tolist()
    answers: list[dict[str, Any]] = [
        {"x": x, "y": y, **of_tile} for of_tile, tile in zip(flags, found, strict=True) for x, y in tile
    ]
    return of_stream(Positions(), "", sent, answers)


def picture() -> Block:
    """Part of a canvas of odd sides, with holes and with words that could not be read."""
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
        "",
        {"i": rows("i", [{"columns": columns, "lines": lines, "border": border}]), "i_words": rows("i_words", read)},
        {"o": rows("o", shown), "o_bursts": rows("o_bursts", asked)},
        {"i_page": page, "i_held": 1, "i_stop": 0},
    )


@table(picture=Row(picture, clocks_each=1), blending=Row(blending, clocks_each=1), positions=places)
def test_a_part_of_the_painter_answers_as_the_golden_model(row: Row) -> None:
    check(row)
