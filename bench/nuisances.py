"""What flights survive: rendered flights with one nuisance each, in three strengths, against their true homographies.

Each flight has ten photographs of 800×600 px (75 % forward, 60 % side overlap where nothing else is said). The error is
the median distance, over the overlap of two neighbouring photographs that were placed, between where the mosaic and
where the truth puts a point of the first in the second: the median of all neighbours, and in brackets the largest.
Where a nuisance moves pixels, the truth is that of the pictures with the nuisance.
"""

import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import cv2
import numpy as np
import typer
from rich.console import Console
from rich.progress import track

from bench.flight_pairs import draw_display
from bench.report import Row, reported
from golden_model.arrays import Array
from sim.scene import Flight, make_lawnmower
from skymosaic.common.errors import RegistrationError
from skymosaic.geometry.homography import apply, grid_over
from skymosaic.mosaicking.api import mosaic

SIZE_PX = (800, 600)
SEED = 11
IMAGES = 10
MIN_OVERLAP = 0.1
THERMAL_BASE, THERMAL_NOISE = 7400, 3
"""Raw numbers of an uncooled thermal camera at ground temperature."""
MURKY_LEVEL, MURKY_CONTRAST = 110, 0.15

Picture = np.ndarray[Any, np.dtype[Any]]
Render = Callable[[float], Flight]
Change = Callable[[Picture, int, float], Picture]
Shift = Callable[[Array, int, float], Array]


@dataclass(frozen=True)
class Nuisance:
    """One nuisance: how it changes the flight, or its pictures, by strength."""

    strengths: tuple[float, float, float]
    """From what is common to what is hard."""
    meaning: str
    """What the strength is."""
    flight: Render = lambda _strength: make_lawnmower(SEED, IMAGES, SIZE_PX)
    """The flight of a strength."""
    change: Change = lambda picture, _number, _strength: picture
    """A picture, its number and the strength, to the picture that is saved; pixels stay where they are."""
    shift: Shift | None = None
    """How far to the left each line is shifted, px, by its position, the picture's number and the strength."""
    jpeg: bool = False
    """Whether the strength is the quality of a JPEG file; otherwise files are lossless."""


def _change(what: str, **changes: Callable[[float, int, float], float]) -> Render:
    """A flight with other ``poses`` or ``photometries``: a value, the number and the strength, to the new value."""

    def render(strength: float) -> Flight:
        flight = make_lawnmower(SEED, IMAGES, SIZE_PX)
        changed = tuple(
            replace(each, **{name: of(getattr(each, name), number, strength) for name, of in changes.items()})
            for number, each in enumerate(getattr(flight, what))
        )
        fields: dict[str, Any] = {what: changed}
        return replace(flight, **fields)

    return render


def thermal(picture: Picture, number: int, contrast: float) -> Picture:
    """Raw numbers of a thermal camera: few counts of contrast, blurred by its optics, with noise."""
    gray = cv2.GaussianBlur(cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY), (0, 0), 1.2).astype(float)
    noise = np.random.default_rng(number).normal(0, THERMAL_NOISE, gray.shape)
    return np.asarray(np.clip(THERMAL_BASE + (255 - gray) / 255 * contrast + noise, 0, 65535).astype(np.uint16))


def haze(picture: Picture, _number: int, contrast: float) -> Picture:
    """A bright veil that leaves a share of the contrast."""
    return np.asarray((picture * contrast + 220 * (1 - contrast)).astype(np.uint8))


def murk(picture: Picture, _number: int, sigma_px: float) -> Picture:
    """Soft ground of little contrast, brighter towards the light ahead of the camera, as on the sea floor."""
    soft = MURKY_LEVEL + MURKY_CONTRAST * (cv2.GaussianBlur(picture, (0, 0), sigma_px).astype(float) - MURKY_LEVEL)
    return np.asarray(np.clip(soft * np.linspace(1.25, 0.65, len(picture))[:, None, None], 0, 255).astype(np.uint8))


def display(picture: Picture, number: int, lines: float) -> Picture:
    """Lines of white text at the same place in every picture, as a ground station burns them in."""
    shown, _ = draw_display(picture, np.random.default_rng(1), np.random.default_rng(number), lines=int(lines))
    return shown


def steady_turn(y: Array, number: int, shear_px: float) -> Array:
    """A camera that turns at a steady rate while its lines are read: a shear, other in each picture."""
    return np.asarray(shear_px * np.sin(1.7 * number) * (y / SIZE_PX[1] - 0.5))


def vibration(y: Array, number: int, amplitude_px: float) -> Array:
    """A camera that swings twice while its lines are read, from another phase in each picture."""
    return np.asarray(amplitude_px * np.sin(4 * np.pi * y / SIZE_PX[1] + 1.7 * number))


def water(picture: Picture, number: int, share: float) -> Picture:
    """Waves, new in every picture, over a share of it from the top."""
    rows = round(share * len(picture))
    waves = cv2.GaussianBlur(np.random.default_rng(number).normal(0, 40, (rows, SIZE_PX[0])), (0, 0), 4)
    shown = picture.copy()
    shown[:rows] = np.clip(np.array([120, 90, 60]) + 0.8 * waves[..., None], 0, 255)
    return shown


NUISANCES = {
    "dark, with noise": Nuisance(
        (0.3, 0.15, 0.07), "gain", _change("photometries", gain=lambda *given: given[-1], noise_sigma=lambda *_: 4.0)
    ),
    "haze": Nuisance((0.5, 0.25, 0.1), "contrast left", change=haze),
    "every third blurred": Nuisance(
        (1.5, 3, 5),
        "sigma, px",
        _change("photometries", blur_sigma_px=lambda _old, number, sigma: sigma if number % 3 == 1 else 0.5),
    ),
    "JPEG": Nuisance((30, 15, 5), "quality", jpeg=True),
    "thermal, 16 bits": Nuisance((300, 100, 30), "contrast, counts", change=thermal),
    "overlap": Nuisance(
        (0.5, 0.35, 0.2),
        "forward and side",
        lambda overlap: make_lawnmower(SEED, IMAGES, SIZE_PX, forward_overlap=overlap, side_overlap=overlap),
    ),
    "two heights": Nuisance(
        (1.5, 3, 5),
        "ratio",
        _change("poses", altitude_px=lambda old, number, ratio: old * (ratio if number % 2 else 1)),
    ),
    "camera leans forward": Nuisance((15, 25, 35), "degrees", _change("poses", pitch_deg=lambda *given: given[-1])),
    "lens": Nuisance((-0.1, -0.25, -0.35), "k1", lambda k1: make_lawnmower(SEED, IMAGES + 4, SIZE_PX, k1=k1)),
    "rolling shutter, steady turn": Nuisance((2, 6, 12), "shear, px", shift=steady_turn),
    "rolling shutter, vibration": Nuisance((0.5, 1, 3), "amplitude, px", shift=vibration),
    "text burned in": Nuisance((2, 6, 12), "lines", change=display),
    "water": Nuisance((0.3, 0.5, 0.7), "share of the picture", change=water),
    "soft, murky, lit from ahead": Nuisance((3, 5, 8), "sigma, px", change=murk),
}


@reported("rendered flights of ten photographs")
def nuisances(
    names: Annotated[list[str] | None, typer.Argument(help=f"Of: {', '.join(NUISANCES)}.")] = None,
) -> Iterator[Row]:
    """What flights survive, from darkness to water; those measured replace their rows in the file."""
    for name in track(names or list(NUISANCES), console=Console(stderr=True)):
        nuisance = NUISANCES[name]
        outcomes = [measure(nuisance, strength) for strength in nuisance.strengths]
        strengths = f"{', '.join(map(str, nuisance.strengths))} ({nuisance.meaning})"
        yield {"nuisance": name, "strengths": strengths, "error, px": " · ".join(outcomes)}


def measure(nuisance: Nuisance, strength: float) -> str:
    """The error of a flight, and how many photographs were placed where some were not."""
    flight = nuisance.flight(strength)
    with tempfile.TemporaryDirectory() as folder:
        suffix, quality = (".jpg", [cv2.IMWRITE_JPEG_QUALITY, int(strength)]) if nuisance.jpeg else (".tif", [])
        for number, image in enumerate(flight.images):
            path = Path(folder) / f"{number:02}{suffix}"
            picture = nuisance.change(image, number, strength)
            if nuisance.shift:
                y, x = np.indices(picture.shape[:2], dtype=np.float32)
                read_at = x + nuisance.shift(y, number, strength).astype(np.float32)
                picture = cv2.remap(picture, read_at, y, cv2.INTER_CUBIC)
            cv2.imwrite(str(path), picture, quality)
        try:
            result = mosaic([folder])
        except RegistrationError:
            return f"0 of {IMAGES}"
    shift = nuisance.shift or (lambda y, _number, _strength: np.zeros_like(y))
    errors = neighbour_errors_px(flight, result.transforms, lambda y, number: shift(y, number, strength))
    missing = f", {len(result.placed)} of {len(flight.poses)}" if len(result.placed) < len(flight.poses) else ""
    return f"{np.median(errors):.2f} ({max(errors):.2f}){missing}"


def neighbour_errors_px(
    flight: Flight, transforms: dict[int, Array], shift: Callable[[Array, int], Array]
) -> list[float]:
    """The median error of each two neighbours that were placed and overlap, whose lines are shifted."""
    grid = grid_over(SIZE_PX, 9)
    errors = []
    for left in range(len(flight.poses) - 1):
        right = left + 1
        if not {left, right} <= transforms.keys() or flight.overlap_between(left, right) < MIN_OVERLAP:
            continue
        rendered = np.stack([grid[:, 0] + shift(grid[:, 1], left), grid[:, 1]], axis=1)
        true = apply(flight.homography_between(left, right), rendered)
        true[:, 0] -= shift(true[:, 1], right)
        visible = ((true >= 0) & (true < SIZE_PX)).all(axis=1)
        between = np.linalg.inv(transforms[right]) @ transforms[left]
        errors.append(float(np.median(np.linalg.norm(apply(between, grid[visible]) - true[visible], axis=1))))
    return errors
