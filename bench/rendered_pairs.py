"""Renders pairs of views with zoom, tilt or relief and writes them as a folder that `bench/registration.py` reads.

    python bench/rendered_pairs.py DIR [--each N] [--kind zoom --kind tilt]

The truth is known exactly. ``zoom_3`` shows the same place from three times the height, at any heading; ``tilt_60``
looks at it from 60 degrees off the vertical, at any heading and from any side. The nearer view has one pixel for each
ground pixel, so no view shows less detail than a camera would.
"""

from __future__ import annotations

import csv
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import cv2
import numpy as np
import typer
from numpy.typing import NDArray
from rich.progress import track

from sim.scene import Camera, CameraPose, Photometry, render_ground, render_view
from sim.scene.camera import find_visible_box
from skymosaic.evaluation.known_pairs import COLUMNS, LIST_NAME
from skymosaic.imagery.images import save

ZOOMS = (1.5, 2.0, 2.5, 3.0, 3.5, 4.0)
TILTS_DEG = (20, 30, 40, 50, 60)
KINDS = ("zoom", "tilt")
SIZE_PX = (640, 480)
OVERSAMPLING = 2
"""Views are rendered larger and reduced by area: a tilted view averages more ground in one direction than another."""
FOCAL_WIDTHS = {"zoom": 0.8, "tilt": 1.6}
"""Focal length in image widths. 0.8 is a common drone's; a tilt of 60 degrees needs a narrower view, or it would show
the horizon."""
LANDSCAPES = 3
"""Seeds of the landscapes that all pairs come from; their tiles are cached."""

Matrix = NDArray[np.float64]
Pixels = NDArray[np.uint8]


@dataclass(frozen=True)
class RenderedPair:
    """Two gray views and the homography from left to right pixels."""

    name: str
    group: str
    left: Pixels
    right: Pixels
    truth: Matrix


def rendered_pairs(kind: str, each: int) -> Iterator[RenderedPair]:
    """``each`` pairs for every zoom, or every tilt."""
    for step in ZOOMS if kind == "zoom" else TILTS_DEG:
        for number in range(each):
            yield make_pair(kind, step, number)


def make_pair(kind: str, step: float, number: int) -> RenderedPair:
    """Pair ``number`` of a zoom (a factor) or a tilt (degrees); the same on every run."""
    rng = np.random.default_rng([KINDS.index(kind), round(10 * step), number])
    width_px, height_px = SIZE_PX
    camera = Camera(width_px=width_px, height_px=height_px, focal_px=FOCAL_WIDTHS[kind] * width_px)
    centre = rng.uniform(-300, 300, 2)
    heading_deg, turn_deg = rng.uniform(0, 360), rng.uniform(-180, 180)
    # The middle of the other view, up to a tenth of its width away.
    other = centre + rng.uniform(-0.1, 0.1, 2) * width_px
    near = CameraPose(x_px=centre[0], y_px=centre[1], altitude_px=camera.focal_px, heading_deg=heading_deg)
    if kind == "zoom":
        far = replace(near, x_px=other[0], y_px=other[1], altitude_px=camera.focal_px * step)
    else:
        # The distance along the optical axis stays, so that the scale in the middle does.
        pose = replace(near, x_px=0, y_px=0, altitude_px=camera.focal_px * np.cos(np.radians(step)), pitch_deg=step)
        axis = replace(pose, heading_deg=heading_deg + turn_deg).rotation[:, 2]
        ground = other - axis[:2] / axis[2] * pose.altitude_px
        far = replace(pose, x_px=ground[0], y_px=ground[1])
    far = replace(far, heading_deg=heading_deg + turn_deg)
    poses = [near, far] if number % 2 else [far, near]
    photometries = (
        Photometry(blur_sigma_px=0.4, noise_sigma=1.5, vignetting=0.1),
        Photometry(gain=rng.uniform(0.8, 0.95), gamma=rng.uniform(1, 1.15), noise_sigma=2.0, vignetting=0.1),
    )
    left, right = (
        _view(number % LANDSCAPES, pose, camera, photometry, rng)
        for pose, photometry in zip(poses, photometries, strict=True)
    )
    to_left, to_right = (pose.homography(camera) for pose in poses)
    truth = to_right @ np.linalg.inv(to_left)
    group = f"{kind}_{step:g}"
    return RenderedPair(f"{group}_{number:02d}", group, left, right, truth / truth[2, 2])


def _view(landscape: int, pose: CameraPose, camera: Camera, photometry: Photometry, rng: np.random.Generator) -> Pixels:
    large = Camera(**{name: value * OVERSAMPLING for name, value in vars(camera).items()})
    left, top, width_px, height_px = find_visible_box(pose, large)
    ground = render_ground(landscape, width_px, height_px, (left, top))
    view = render_view(ground, pose, large, Photometry(), rng, origin=(left, top))
    reduced = cv2.resize(view, (camera.width_px, camera.height_px), interpolation=cv2.INTER_AREA)
    return cv2.cvtColor(photometry.apply(np.asarray(reduced, np.uint8), rng), cv2.COLOR_BGR2GRAY)


def main(
    folder: Annotated[Path, typer.Argument(help="Where images and pairs.csv are written.")],
    each: Annotated[int, typer.Option(min=1, help="Pairs for every zoom and every tilt.")] = 10,
    kind: Annotated[list[str] | None, typer.Option(help="zoom, tilt; by default both.")] = None,
) -> None:
    """Render the pairs and list them."""
    (folder / "images").mkdir(parents=True, exist_ok=True)
    with (folder / LIST_NAME).open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(COLUMNS)
        steps = len(ZOOMS) * ("zoom" in (kind or KINDS)) + len(TILTS_DEG) * ("tilt" in (kind or KINDS))
        pairs = (pair for chosen in kind or KINDS for pair in rendered_pairs(chosen, each))
        for pair in track(pairs, total=steps * each, description="rendering"):
            names = [f"images/{pair.name}_{side}.png" for side in ("left", "right")]
            for name, image in zip(names, (pair.left, pair.right), strict=True):
                save(folder / name, image)
            writer.writerow([pair.name, pair.group, *names, *pair.truth.ravel().tolist()])


if __name__ == "__main__":
    typer.run(main)
