"""The painter at zooms from 0.5 to 2: how exact, and how many frames per second.

    python -m bench.painter_zooms

A zoom is px of the frame per px of the canvas. Each row holds the worst of seven headings from 0 to 90°, by the golden
model: dB of a rendered frame of 640x480 against the same warp in double precision; tiles of frames of 1280x720 and
1920x1080 of which double precision sees a pixel, and those of them that the painter does not paint; and the frames of
these sizes that it paints per second, by the clocks that it takes where memory never waits.
"""

from dataclasses import replace

import cv2
import numpy as np
import typer
from scipy.ndimage import map_coordinates

from bench.painter import CLOCK_MHZ, fit_canvas, fly, pose_of
from bench.report import JsonFile, Row, report
from golden_model.arrays import Matrix, Pixels
from golden_model.painting.painter import Painter
from golden_model.painting.tiles import MAX_TILES, TILE_PX
from golden_model.painting.timing import painting_cycles
from sim.scene import CameraPose

ZOOMS = (0.5, 0.7, 1.0, 1.4, 1.5, 2.0)
HEADINGS_DEG = range(0, 91, 15)
PICTURE = (640, 480)
VIDEOS = ((1280, 720), (1920, 1080))
INSIDE = np.stack(np.meshgrid(*[np.arange(TILE_PX, dtype=float)] * 2), axis=-1)
"""x and y of the pixels of a tile."""


def look_down(size: tuple[int, int], zoom: float, heading_deg: float) -> tuple[Matrix, tuple[int, int]]:
    """Canvas to frame, and the size of a canvas in tiles that holds the frame, or as much of it as the largest can."""
    flight = fly(size, 1, shake=0)
    altitude_px = flight.camera.focal_px / zoom
    pose = CameraPose(x_px=0, y_px=0, altitude_px=altitude_px, heading_deg=heading_deg)
    flight = replace(flight, poses=(pose,))
    move, (columns, rows) = fit_canvas(flight)
    return flight.homographies[0] @ move, (min(columns, MAX_TILES), min(rows, MAX_TILES))


def decibels(image: Pixels, H: Matrix, tiles: tuple[int, int]) -> float:
    """Signal to noise of a frame on the canvas, but for the pixels at its border."""
    painter = Painter(*tiles)
    painter.paint(image, pose_of(H))
    y, x = np.nonzero(painter.picture[..., 3] > 1)
    at = cv2.perspectiveTransform(np.stack([x, y], axis=-1)[None].astype(float), H)[0]
    exact = [map_coordinates(channel.astype(float), at[:, ::-1].T, order=1) for channel in np.moveaxis(image, -1, 0)]
    errors = painter.picture[y, x, :3].T - np.array(exact)
    return float(10 * np.log10(255**2 / np.mean(errors**2)))


def count_tiles(size: tuple[int, int], zoom: float, heading_deg: float) -> tuple[int, int, int]:
    """Tiles in which a frame is, those of them that are not painted, and the clocks of it all."""
    H, tiles = look_down(size, zoom, heading_deg)
    plan = Painter(*tiles).plan(size, pose_of(H))
    seen = missed = 0
    painted = {(column, row) for column, row in plan.tiles[plan.painted].tolist()}
    for tile in np.ndindex(tiles):
        at = cv2.perspectiveTransform(INSIDE + TILE_PX * np.array(tile), H)
        if ((at >= 0) & (at < np.array(size) - 1)).all(axis=-1).any():
            seen += 1
            missed += tile not in painted
    return seen, missed, painting_cycles(plan, *tiles)


def main(json_file: JsonFile = None) -> None:
    """Measure."""
    rows: list[Row] = []
    image = fly(PICTURE, 1, shake=0).images[0]
    for zoom in ZOOMS:
        signal = [decibels(image, *look_down(PICTURE, zoom, degrees)) for degrees in HEADINGS_DEG]
        row: Row = {"zoom": zoom, "dB": round(min(signal), 1)}
        counts = np.array([[count_tiles(size, zoom, degrees) for degrees in HEADINGS_DEG] for size in VIDEOS])
        row |= {"tiles": int(counts[..., 0].sum()), "missed": int(counts[..., 1].sum())}
        for size, clocks in zip(VIDEOS, counts[..., 2].max(axis=1).tolist(), strict=True):
            row[f"frames per second of {size[0]}×{size[1]}"] = int(CLOCK_MHZ * 1e6 // clocks)
        rows.append(row)
    report(f"The painter at {CLOCK_MHZ} MHz, by its model", rows, json_file)


if __name__ == "__main__":
    typer.run(main)
