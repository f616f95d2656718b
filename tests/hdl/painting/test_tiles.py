# amaranth: UnusedElaboratable=no
"""Every tile that the golden model finds is offered, in its order, whatever the pose."""

import numpy as np

from golden_model.painting.tiles import touched
from hdl.blocks.vectors import Block, of_stream
from hdl.painting.tiles import TileWalker
from tests.golden_model.painting.poses import homography, pose
from tests.hdl.painting.payloads import pose_columns
from tests.hdl.rows import row_test

SIZE = (90, 70)
TILES = (7, 9)
SETTINGS = {"i_width_px": SIZE[0], "i_height_px": SIZE[1], "i_columns": TILES[0], "i_rows": TILES[1]}


def poses() -> list[np.ndarray]:
    """Level, turned, far too large, with a horizon across the canvas, wholly behind it, and off the canvas."""
    middle = (100, 130)
    horizon = homography(SIZE, middle, turn=2, tilt=(4e-3, -9e-3))
    assert horizon[2] @ (0, 280, 1) < 0 < horizon[2] @ (100, 130, 1)
    return [
        pose(each)
        for each in (
            homography(SIZE, middle, turn=0.3, zoom=1.3),
            homography(SIZE, middle, turn=-2.2, zoom=0.25),
            horizon,
            -homography(SIZE, middle),
            homography(SIZE, (500, -90), turn=1),
            homography(SIZE, (0, 0), turn=4, zoom=2),
        )
    ]


def walked(given: list[np.ndarray], **settings: int) -> Block:
    columns = [dict(zip("xyw", column, strict=True)) for each in given for column in pose_columns(each)]
    found = [tile for each in given for tile in touched(each, SIZE, TILES, all_tiles=bool(settings)).tolist()]
    tiles = [dict(zip(("column", "row"), tile, strict=True)) for tile in found]
    return of_stream(TileWalker(), "", columns, tiles, **SETTINGS, **settings)


# The reset falls into the way of another pose.
test_rows = row_test({
    "poses": lambda: walked(poses()),
    "turned first": lambda: walked(poses()[::-1]),
    "replaced": lambda: walked(poses()[3:], i_replace=1),
})  # fmt: skip
