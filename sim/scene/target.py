"""A film of a car that drives through the landscape, with its exact corners in every picture."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from golden_model.arrays import Array, Float32, Pixels
from sim.scene.camera import Camera, Photometry, poses_along, project
from sim.scene.flight import FOCAL_WIDTHS, Flight, RenderedImages
from sim.scene.noise import Stream, make_noise, make_rng

SPEED_PX = 3.0
"""Distance that the car drives from one picture to the next: 40 km/h at 25 pictures per second."""
HIDDEN_IMAGES = 10
"""Number of pictures in which the bridge hides the whole car."""

_CAR_PX = (30.0, 13.0)
"""Length and width of the car on the ground: 4.5 m by 2 m."""
_DECK_PX = (_CAR_PX[0] + HIDDEN_IMAGES * SPEED_PX, 150.0)
"""Size of the bridge along and across the car's path."""
_DETAIL = 8
"""Pixels of the painted car and bridge deck per ground pixel."""
_RIM = 8
"""Transparent pixels around them, so that their edges stay smooth after warping."""
_BODIES = ((222, 222, 218), (60, 62, 168), (120, 76, 44), (66, 70, 74), (60, 150, 206))
_DARK, _WHITE, _RED = (44, 38, 34), (250, 250, 250), (40, 40, 200)
_WINDOWS_AND_LAMPS = (
    (_DARK, (60, 0), (62, -0.66), (74, -0.78), (77, 0)),  # windscreen
    (_DARK, (22, 0), (21, -0.66), (14, -0.74), (13, 0)),  # rear window
    (_DARK, (26, -0.76), (58, -0.76), (66, -0.88), (20, -0.88)),  # side windows
    (_WHITE, (95, -0.9), (99, -0.8), (99, -0.5), (96, -0.6)),  # headlamps
    (_RED, (1, -0.9), (4, -0.9), (4, -0.5), (1, -0.5)),  # rear lamps
)
"""Colour, and corners of the left half: x in hundredths of the car's length, y in half widths from its axis."""
_FONT = cv2.FONT_HERSHEY_SIMPLEX
_LENS = Photometry(blur_sigma_px=0.4, noise_sigma=2.0, vignetting=0.1)

Layer = Float32
"""Opacity, and BGR times opacity, shape (H, W, 4)."""


@dataclass(frozen=True)
class Pursuit:
    """A film of a moving car."""

    flight: Flight
    """Landscape, camera and poses, one for each picture; its pictures have no lens effects."""
    car_to_ground: tuple[Array, ...]
    """For each picture, the (3, 3) matrix from car coordinates to ground pixels. Car coordinates are in ground pixels
    from the car's centre, x ahead and y to its right."""
    bridge_to_ground: Array | None
    """The same for the bridge deck under which the car drives; None without a bridge."""

    @property
    def images(self) -> Sequence[Pixels]:
        """The pictures, (H, W, 3) uint8 BGR; each is rendered when it is read, and not kept."""
        car, deck = _paint_car(make_rng(self.flight.seed, Stream.PURSUIT, 1)), _paint_deck(self.flight.seed)
        return RenderedImages(len(self.car_to_ground), lambda number: self._render(number, car, deck))

    def _render(self, number: int, car: Layer, deck: Layer) -> Pixels:
        image = self.flight.images[number].astype(np.float32)
        _lay_over(image, car, self.car_to_images[number])
        if self.bridge_to_ground is not None:
            _lay_over(image, deck, self.flight.homographies[number] @ self.bridge_to_ground)
        return _LENS.apply(image, make_rng(self.flight.seed, Stream.SENSOR, number))

    @property
    def corners(self) -> Array:
        """Corners of the car in every picture, shape (N, 4, 2): front left, front right, rear right, rear left."""
        return np.stack([project(to_image, _outline(_CAR_PX)) for to_image in self.car_to_images])

    @property
    def car_to_images(self) -> tuple[Array, ...]:
        """For each picture, the (3, 3) matrix from car coordinates to its pixels."""
        to_images = zip(self.flight.homographies, self.car_to_ground, strict=True)
        return tuple(to_image @ to_ground for to_image, to_ground in to_images)

    @property
    def visible(self) -> Array:
        """For each picture, the share of the car that the bridge does not hide, 0..1, shape (N,)."""
        if self.bridge_to_ground is None:
            return np.ones(len(self.car_to_ground))
        deck = project(self.bridge_to_ground, _outline(_DECK_PX)).astype(np.float32)
        cars = [project(to_ground, _outline(_CAR_PX)).astype(np.float32) for to_ground in self.car_to_ground]
        return np.array([1 - cv2.intersectConvexConvex(car, deck)[0] / np.prod(_CAR_PX) for car in cars])


def make_pursuit(
    seed: int, images: int, size: tuple[int, int] = (640, 480), *, magnification: float = 2.0, bridge: bool = False
) -> Pursuit:
    """A film by a camera that follows a car along a winding path, and climbs, turns and tilts a little.

    Parameters
    ----------
    seed : int
        Landscape, car, paths and noise; non-negative.
    images : int
        Number of pictures, 25 per second.
    size : (int, int)
        Width and height of the pictures.
    magnification : float
        Pixels of the picture per ground pixel; the car is about ``30 * magnification`` px long.
    bridge : bool
        Whether the car drives under a bridge halfway.
    """
    rng = make_rng(seed, Stream.PURSUIT)
    time = np.arange(images)
    heading = rng.uniform(0, 2 * np.pi) + _make_wave(time, 0.5, 25, rng)
    x, y = rng.uniform(-500, 500, (2, 1)) + SPEED_PX * np.cumsum([np.cos(heading), np.sin(heading)], axis=1)
    car_to_ground = tuple(_place_car(*values) for values in zip(x, y, heading, strict=True))
    camera = Camera(width_px=size[0], height_px=size[1], focal_px=FOCAL_WIDTHS * size[0])
    sway_px = 0.15 * size[1] / magnification
    poses = poses_along(
        x_px=x + _make_wave(time, sway_px, 15, rng),
        y_px=y + _make_wave(time, sway_px, 19, rng),
        altitude_px=camera.focal_px / magnification * (1 + _make_wave(time, 0.1, 23, rng)),
        heading_deg=rng.uniform(0, 360) + _make_wave(time, 10, 30, rng),
        pitch_deg=_make_wave(time, 1.5, 11, rng),
        roll_deg=_make_wave(time, 1.5, 13, rng),
    )
    flight = Flight(seed, camera, poses, (Photometry(),) * images)
    return Pursuit(flight, car_to_ground, car_to_ground[images // 2] if bridge else None)


def _make_wave(time: NDArray[np.int64], amplitude: float, period: float, rng: np.random.Generator) -> Array:
    return np.asarray(amplitude * np.sin(time / period + rng.uniform(0, 2 * np.pi)))


def _place_car(x: float, y: float, heading: float) -> Array:
    cos, sin = np.cos(heading), np.sin(heading)
    return np.array([[cos, -sin, x], [sin, cos, y], [0, 0, 1]])


def _outline(size_px: tuple[float, float]) -> Array:
    """Corners of a rectangle around the origin, shape (4, 2): front left, front right, rear right, rear left."""
    return np.array([[1, -1], [1, 1], [-1, 1], [-1, -1]]) / 2 * size_px


def _lay_over(image: Float32, layer: Layer, to_image: Array) -> None:
    """Draw a layer on the image, in place; ``to_image`` maps ground pixels, counted from the layer's centre."""
    height, width = layer.shape[:2]
    to_ground = np.array([[1, 0, (1 - width) / 2], [0, 1, (1 - height) / 2], [0, 0, _DETAIL]])
    middle, ahead = project(to_image, np.array([[0, 0], [1, 0]]))
    reduction = _DETAIL / np.linalg.norm(ahead - middle)
    # As in the camera: blur first, so that a pixel of the smaller picture averages the pixels that it covers.
    smooth = cv2.GaussianBlur(layer, (0, 0), 0.5 * np.sqrt(reduction**2 - 1)) if reduction > 1 else layer
    drawn = cv2.warpPerspective(smooth, to_image @ to_ground, image.shape[1::-1], flags=cv2.INTER_LINEAR)
    image *= 1 - drawn[..., :1]
    image += drawn[..., 1:]


def _paint_car(rng: np.random.Generator) -> Layer:
    """A car in a random colour, with windows, lamps, stripes and a number on its roof; its front is to the right."""
    length, width = (round(side * _DETAIL) for side in _CAR_PX)
    body = np.asarray(rng.choice(_BODIES))
    picture = np.full((width, length, 3), body, np.uint8)
    for colour, *outline in _WINDOWS_AND_LAMPS:
        shape = np.array(outline) * (length / 100, width / 2) + (0, width / 2)
        for mirrored in (shape, (0, width) + shape * (1, -1)):
            cv2.fillPoly(picture, [np.rint(mirrored).astype(np.int32)], colour, cv2.LINE_AA)
    stripe = tuple(int(255 - level) for level in body)
    for y in (0.4, 0.6):
        for start, end in ((0.03, 0.13), (0.76, 0.97)):
            middle = round(y * width)
            cv2.line(picture, (round(start * length), middle), (round(end * length), middle), stripe, 5, cv2.LINE_AA)
    number = str(rng.integers(100, 1000))
    cv2.putText(picture, number, (round(0.27 * length), round(0.66 * width)), _FONT, 1.4, stripe, 4, cv2.LINE_AA)
    opacity = np.zeros((width, length), np.uint8)
    corner = round(0.08 * width)
    cv2.rectangle(opacity, (corner, corner), (length - 1 - corner, width - 1 - corner), 255, cv2.FILLED)
    cv2.rectangle(opacity, (corner, corner), (length - 1 - corner, width - 1 - corner), 255, 2 * corner, cv2.LINE_AA)
    return _make_layer(picture, opacity)


def _paint_deck(seed: int) -> Layer:
    """A concrete bridge with stains and railings; the car drives to the right."""
    length, width = (round(side * _DETAIL) for side in _DECK_PX)
    noise = make_noise(seed, 0, 0, length, width)
    tone = 150 + 6 * noise[1] + 8 * noise[3] + 10 * noise[5] + 8 * noise[7]
    tone[:, [*range(8), *range(length - 8, length)]] -= 70
    return _make_layer(
        np.clip(tone, 0, 255)[..., np.newaxis] * (0.96, 1.0, 1.02), np.full((width, length), 255, np.uint8)
    )


def _make_layer(picture: NDArray[np.generic], opacity: Pixels) -> Layer:
    share = opacity[..., np.newaxis].astype(np.float32) / 255
    layer = np.concatenate([share, share * picture.astype(np.float32)], axis=2)
    return np.pad(layer, ((_RIM, _RIM), (_RIM, _RIM), (0, 0)))
