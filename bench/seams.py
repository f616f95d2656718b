"""Seams of a mosaic whose frames the chip places, by its own homographies and a host that says now and then where.

    python -m bench.seams

A rendered flight of 240 frames in six legs, 90 % forward and 50 % side overlap. The chip's homographies are those of
the golden model, its poses too; nothing is painted. The host places each frame by its features and lays all out anew
every ten frames. Painting starts with the first layout. An anchor comes late: that of a frame is set when the next
frame's homography is there, and counts from the frame after that.
"""

import dataclasses
import time
from collections import defaultdict
from collections.abc import Mapping, Sequence

import numpy as np
import typer
from numpy.typing import NDArray

from bench.report import JsonFile, Row, report
from golden_model.arrays import Array, Matrix
from golden_model.config import PRESETS, EstimatorConfig
from golden_model.front_end import extract
from golden_model.geometry.fixed_point import quantise
from golden_model.painting.pose import Placement, Poses, placement_of
from sim.backends.golden import add_matches
from sim.backends.interface import FrameResult
from sim.scene import Camera, make_lawnmower
from skymosaic.geometry.fabric import in_pixels
from skymosaic.geometry.homography import apply
from skymosaic.mosaicking.live.anchors import Anchors

FRAMES, SIZE_PX = 240, (640, 480)
CONFIG = dataclasses.replace(PRESETS["aerial"], estimator=EstimatorConfig())
LAYOUT_EVERY = 10
LAYOUT_FRAMES = 5
"""Frames that come during a layout: at 1.4 per second, as such a flight at 10 m/s needs them, it takes 3.5 s."""
DELAY = 1
"""Frames that come while the host places one."""
LEG_OVERLAP = 10
"""Frames that are farther apart in time, and meet, are of different legs."""
STEP_PX = 4
"""Pixels of the canvas between two that are looked at."""


def main(json_file: JsonFile = None) -> None:
    """Measure."""
    flight = make_lawnmower(7, FRAMES, SIZE_PX, forward_overlap=0.9, side_overlap=0.5, exposure_step=0)
    extracted = (extract(image, CONFIG.front_end, frame=n) for n, image in enumerate(flight.images))
    frames = list(add_matches(extracted, CONFIG, "previous"))
    anchors, place_s, layout_s = find_anchors(frames)
    # The ground, as large as on the canvas and as it is turned there.
    to_ground = invert(flight.homographies[0])
    truth = {number: flight.homographies[number] @ to_ground for number in anchors}
    runs = {
        "by the chip alone": every(FRAMES, anchors),
        "with an anchor every 10 frames": every(10, anchors),
        "with one every 5": every(5, anchors),
        "with one for each that comes in time": {
            number: anchor for number, anchor in anchors.items() if not 0 < number % LAYOUT_EVERY <= LAYOUT_FRAMES
        },
        "with an exact one every 10": every(10, truth),
    }
    rows: list[Row] = []
    for name, chosen in runs.items():
        poses = place_frames(frames, chosen)
        seams = find_seams(flight.camera, poses, flight.homographies)
        seams_px = np.concatenate([*seams.values()])
        legs_px = np.concatenate([px for (i, j), px in seams.items() if abs(i - j) > LEG_OVERLAP])
        rows.append(
            {
                "frames are placed": name,
                "frames": len(poses),
                "seams, 90th percentile (px)": round(float(np.percentile(seams_px, 90)), 2),
                "worst": round(float(seams_px.max()), 1),
                "between legs, median": round(float(np.median(legs_px)), 2),
                "between legs, 90th percentile": round(float(np.percentile(legs_px, 90)), 2),
            }
        )
    report("Seams", rows, json_file)
    print(f"processor time of the host: {max(place_s):.2f} s for a frame, {max(layout_s):.1f} s for a layout, at most")


def every(frames: int, anchors: Mapping[int, Matrix]) -> dict[int, Matrix]:
    """The first anchor, and those of one frame in so many."""
    first = min(anchors)
    return {number: anchor for number, anchor in anchors.items() if number % frames == 0 or number == first}


def find_anchors(frames: Sequence[FrameResult]) -> tuple[dict[int, Matrix], list[float], list[float]]:
    """Place every frame by its features; canvas to frame, and seconds for each frame and for each layout."""
    host = Anchors(SIZE_PX, CONFIG)
    anchors, place_s, layout_s = dict[int, Matrix](), list[float](), list[float]()
    for number, frame in enumerate(frames):
        start_s = time.process_time()
        place = host.add(number, frame.features)
        placed_s = time.process_time()
        if number % LAYOUT_EVERY == 0:
            host.lay_out()
            layout_s.append(time.process_time() - placed_s)
        if place is not None:
            anchors[number] = invert(place)
        place_s.append(placed_s - start_s)
    return anchors, place_s, layout_s


def place_frames(frames: Sequence[FrameResult], anchors: Mapping[int, Matrix]) -> dict[int, Matrix]:
    """The pose (canvas to frame, px) by which the chip paints each frame, if a host has such anchors."""
    chip, painted, links = Poses(), dict[int, Matrix](), dict[int, Matrix]()
    for number, frame in enumerate(frames):
        assert frame.homography is not None
        placement = placement_of(frame.homography)
        if placement is not None:
            links[number] = in_pixels(placement.elements)
            pose, _ = chip.place(placement)
            if pose is not None:
                painted[number] = in_pixels(pose)
        anchor = anchors.get(number - DELAY)
        if anchor is not None:
            for later in range(number - DELAY + 1, number + 1):
                anchor = links[later] @ anchor
            chip.place(Placement(number, number, quantise(anchor[np.newaxis])[0], composed=False))
    return painted


def find_seams(
    camera: Camera, poses: Mapping[int, Matrix], homographies: Sequence[Matrix]
) -> dict[tuple[int, int], Array]:
    """How far the ground is misaligned, in pixels of the canvas, at each place where two frames meet.

    Of the frames that cover a pixel of the canvas, the mosaic shows the one whose border is farthest. Where neighbours
    show frames i and j, the ground that i has there is found by the exact homographies (ground to frame), and where j
    has it on the canvas by the pose of j. The distance of both places is the seam's.

    Returns
    -------
    dict of ndarray of float64, shape (N,)
        For two frames that meet, the distance at each pixel where they do; one in `STEP_PX` is looked at.
    """
    owners, low = find_owners(camera, poses)
    found: dict[tuple[int, int], list[Array]] = defaultdict(list)
    for rows, columns in ((0, 1), (1, 0)):
        first = owners[: owners.shape[0] - rows, : owners.shape[1] - columns]
        second = owners[rows:, columns:]
        y, x = np.nonzero((first != second) & (first >= 0) & (second >= 0))
        pairs, places = np.stack([first[y, x], second[y, x]], axis=1), np.stack([x, y], axis=1) * STEP_PX + low
        for i, j in np.unique(pairs, axis=0).tolist():
            here = places[(pairs == (i, j)).all(axis=1)]
            across = invert(poses[j]) @ homographies[j] @ invert(homographies[i]) @ poses[i]
            there = apply(across, here)
            found[i, j].append(np.hypot(*(there - here).T))
    return {pair: np.concatenate(distances) for pair, distances in found.items()}


def find_owners(camera: Camera, poses: Mapping[int, Matrix]) -> tuple[NDArray[np.int64], Array]:
    """Which frame the mosaic shows at each pixel, (H, W), -1 for none; and where on the canvas the first pixel is."""
    outlines = {number: apply(invert(pose), camera.corners) for number, pose in poses.items()}
    low = np.floor(np.min([*outlines.values()], axis=(0, 1)))
    columns, rows = np.ceil((np.max([*outlines.values()], axis=(0, 1)) - low) / STEP_PX).astype(int).tolist()
    y, x = np.mgrid[:rows, :columns]
    owners, farthest = np.full((rows, columns), -1), np.zeros((rows, columns))
    last = np.array([camera.width_px - 1, camera.height_px - 1])
    for number, pose in poses.items():
        left, top = ((outlines[number].min(axis=0) - low) // STEP_PX).astype(int)
        right, bottom = np.ceil((outlines[number].max(axis=0) - low) / STEP_PX).astype(int)
        box = np.s_[top : bottom + 1, left : right + 1]
        inside = apply(pose, np.stack([x[box], y[box]], axis=-1) * STEP_PX + low)
        border = np.minimum(inside, last - inside).min(axis=-1)
        wins = border > farthest[box]
        owners[box][wins], farthest[box][wins] = number, border[wins]
    return owners, low


def invert(homography: Matrix) -> Matrix:
    """The way back."""
    return np.asarray(np.linalg.inv(homography), np.float64)


if __name__ == "__main__":
    typer.run(main)
