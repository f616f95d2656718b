"""The camera: exact homographies over flat ground, rendering, and effects of light, lens and sensor."""

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from golden_model.arrays import Float32, Matrix, Pixels, Points

_RESAMPLING_MARGIN_PX = 4
_MARCH_PX = 0.5
"""Step of a ray over the ground on its way to the surface."""


@dataclass(frozen=True, kw_only=True)
class Camera:
    """A pinhole camera with its principal point at the centre of its images; all lengths are positive."""

    width_px: int
    height_px: int
    focal_px: float
    """Focal length in image pixels."""
    k1: float = 0.0
    """Radial distortion as OpenCV defines it: a ray that a pinhole would see at distance r from the centre, in focal
    lengths, appears at r (1 + k1 r²). Homographies are those of the pinhole."""

    def __post_init__(self) -> None:
        for name in ("width_px", "height_px", "focal_px"):
            if getattr(self, name) <= 0:
                raise ValueError(f"camera {name} is {getattr(self, name)}; it must be positive")

    @property
    def matrix(self) -> Matrix:
        """The calibration matrix K, shape (3, 3); pixel centres at integers."""
        middle_x, middle_y = (self.width_px - 1) / 2, (self.height_px - 1) / 2
        return np.array([[self.focal_px, 0, middle_x], [0, self.focal_px, middle_y], [0, 0, 1]])

    @property
    def corners(self) -> Points:
        """Outer corners of the image, shape (4, 2), clockwise from the top left."""
        right, bottom = self.width_px - 0.5, self.height_px - 0.5
        return np.array([[-0.5, -0.5], [right, -0.5], [right, bottom], [-0.5, bottom]])

    def undistort(self, points: Points) -> Points:
        """Where a pinhole would see what appears at ``points``, (N, 2)."""
        if self.k1 == 0:
            return points
        accurate = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 100, 1e-9)
        distortion = np.array([self.k1, 0, 0, 0])
        moved = cv2.undistortPoints(points[:, None], self.matrix, distortion, P=self.matrix, criteria=accurate)
        return np.asarray(moved[:, 0], dtype=np.float64)


@dataclass(frozen=True, kw_only=True)
class CameraPose:
    """Position and attitude of the camera.

    With all angles 0 it looks straight down, and the top edge of the image points to -y.
    """

    x_px: float
    y_px: float
    """Ground pixel under the camera."""
    altitude_px: float
    """Height over the ground in ground pixels, positive: the image scale is ``focal_px / altitude_px``."""
    heading_deg: float = 0.0
    """Rotation about the vertical, clockwise seen from above."""
    pitch_deg: float = 0.0
    roll_deg: float = 0.0
    """Tilt of the optical axis towards the top and towards the right edge of the image."""

    def __post_init__(self) -> None:
        if self.altitude_px <= 0:
            raise ValueError(f"altitude_px is {self.altitude_px}; it must be positive")

    @property
    def rotation(self) -> Matrix:
        """Camera axes (right, down, forward) as columns in ground axes (x, y, downwards), shape (3, 3)."""
        heading, pitch, roll = np.radians([self.heading_deg, self.pitch_deg, self.roll_deg])
        turns = ([0, 0, heading], [0, roll, 0], [pitch, 0, 0])
        about_z, about_y, about_x = (cv2.Rodrigues(np.array(turn, np.float64))[0] for turn in turns)
        return np.asarray(about_z @ about_y @ about_x, np.float64)

    def homography(self, camera: Camera) -> Matrix:
        """Ground pixels to image pixels, shape (3, 3), scaled to a last element of 1.

        Raises
        ------
        ValueError
            If part of the image shows the horizon or the sky.
        """
        to_ground_plane = np.array([[1, 0, -self.x_px], [0, 1, -self.y_px], [0, 0, self.altitude_px]])
        ground_to_image: Matrix = camera.matrix @ self.rotation.T @ to_ground_plane
        rays = np.column_stack([camera.corners, np.ones(4)]) @ np.linalg.inv(camera.matrix).T @ self.rotation.T
        if rays[:, 2].min() <= 0.05:
            raise ValueError(
                f"pitch {self.pitch_deg} and roll {self.roll_deg} degrees show the horizon; tilt the camera less"
            )
        ground_to_image /= ground_to_image[2, 2]
        return ground_to_image

    def footprint(self, camera: Camera) -> Points:
        """Ground positions of the corners of the image, shape (4, 2), clockwise from the image's top left."""
        return project(np.linalg.inv(self.homography(camera)), camera.undistort(camera.corners))


def poses_along(**fields: ArrayLike) -> tuple[CameraPose, ...]:
    """Poses one after the other, from the values (N,) of their fields."""
    rows = np.column_stack([*fields.values()]).tolist()
    return tuple(CameraPose(**dict(zip(fields, row, strict=True))) for row in rows)


@dataclass(frozen=True, kw_only=True)
class Photometry:
    """Effects of lens, exposure and sensor on a picture; the defaults change nothing.

    They apply in this order: Gaussian blur; ``255 * clip(gain * falloff * value / 255, 0, 1) ** gamma``, where the
    falloff is 1 in the centre and ``1 - vignetting`` in the corners, and ``balance`` multiplies the gain of each
    channel; Gaussian noise in gray levels, independent in each channel.
    """

    gain: float = 1.0
    gamma: float = 1.0
    blur_sigma_px: float = 0.0
    noise_sigma: float = 0.0
    vignetting: float = 0.0
    balance: tuple[float, float, float] = (1.0, 1.0, 1.0)

    def apply(self, image: Pixels | Float32, rng: np.random.Generator) -> Pixels:
        """Return the picture as the camera takes it; ``image`` has shape (H, W, 3) and is not modified."""
        if self.blur_sigma_px > 0:
            image = cv2.GaussianBlur(image, (0, 0), self.blur_sigma_px)
        height, width = image.shape[:2]
        x, y = np.linspace(-1, 1, width, dtype=np.float32), np.linspace(-1, 1, height, dtype=np.float32)
        falloff = 1 - np.float32(self.vignetting / 2) * (x[np.newaxis, :] ** 2 + y[:, np.newaxis] ** 2)
        gains = np.array(self.balance, dtype=np.float32) * np.float32(self.gain / 255)
        exposed = np.clip(np.asarray(image * (falloff[..., np.newaxis] * gains), dtype=np.float32), 0, 1)
        value: Float32 = 255 * exposed ** np.float32(self.gamma)
        if self.noise_sigma > 0:
            value += np.float32(self.noise_sigma) * rng.standard_normal(value.shape, dtype=np.float32)
        return np.clip(np.rint(value), 0, 255).astype(np.uint8)


def project(homography: NDArray[np.floating[Any]], points: Points) -> Points:
    """Map points, shape (n, 2), by a homography."""
    batch = np.asarray(points, np.float64)[np.newaxis]
    return np.asarray(cv2.perspectiveTransform(batch, homography)[0], np.float64)


def find_visible_box(pose: CameraPose, camera: Camera) -> tuple[int, int, int, int]:
    """x, y, width and height of the ground that a view needs, with the margin that its resampling reads."""
    footprint = pose.footprint(camera)
    margin = _RESAMPLING_MARGIN_PX * max(1.0, pose.altitude_px / camera.focal_px)
    left, top = np.floor(footprint.min(axis=0) - margin).astype(int)
    right, bottom = np.ceil(footprint.max(axis=0) + margin).astype(int)
    return int(left), int(top), int(right - left + 1), int(bottom - top + 1)


def render_view(
    ground: Pixels,
    pose: CameraPose,
    camera: Camera,
    photometry: Photometry,
    rng: np.random.Generator,
    *,
    origin: tuple[int, int] = (0, 0),
    heights: NDArray[np.float16] | Float32 | None = None,
) -> Pixels:
    """Render one picture of the ground.

    Parameters
    ----------
    ground : ndarray
        Shape (H, W, 3), uint8. Beyond it the picture is black.
    pose, camera, photometry
        Camera position and attitude, camera, and picture quality.
    rng : numpy.random.Generator
        Source of the sensor noise.
    origin : (int, int)
        Ground coordinates of the pixel ``ground[0, 0]``.
    heights : ndarray or None
        Shape (H, W), heights above the ground, in pixels: objects lean away from the point under the camera and hide
        the ground behind them. None: the ground is flat.

    Returns
    -------
    ndarray
        Shape (camera.height_px, camera.width_px, 3), uint8. Its geometry, where the ground is flat and the lens
        straight, is ``pose.homography(camera)``, up to the 1/32 px to which OpenCV rounds sampling positions.
    """
    left, top, width, height = find_visible_box(pose, camera)
    x, y = max(left - origin[0], 0), max(top - origin[1], 0)
    visible = ground[y : max(top - origin[1] + height, 0), x : max(left - origin[0] + width, 0)]
    if not visible.size:
        raise ValueError(f"the view at ({pose.x_px:.0f}, {pose.y_px:.0f}) misses the ground; move the camera")
    reduction = pose.altitude_px / camera.focal_px
    if reduction > 1:
        # A pixel of the reduced image averages several ground pixels; blur by that amount, less the averaging that the
        # ground's own pixels already contain.
        visible = cv2.GaussianBlur(visible, (0, 0), 0.5 * np.sqrt(reduction**2 - 1))
    shift = np.array([[1, 0, x + origin[0]], [0, 1, y + origin[1]], [0, 0, 1]])
    size = (camera.width_px, camera.height_px)
    if heights is None and camera.k1 == 0:
        image = cv2.warpPerspective(visible, pose.homography(camera) @ shift, size, flags=cv2.INTER_CUBIC)
        return photometry.apply(image, rng)
    pixels = np.stack(np.meshgrid(np.arange(size[0]), np.arange(size[1])), axis=-1).reshape(-1, 2).astype(np.float64)
    at = project(np.linalg.inv(pose.homography(camera) @ shift), camera.undistort(pixels)).astype(np.float32)
    at = at.reshape(size[1], size[0], 2)
    if heights is not None:
        window = heights[y : y + visible.shape[0], x : x + visible.shape[1]].astype(np.float32)
        under = np.array([pose.x_px, pose.y_px]) - (x + origin[0], y + origin[1])
        at = _follow_rays(at, window, under.astype(np.float32), pose.altitude_px)
    return photometry.apply(cv2.remap(visible, at, None, cv2.INTER_CUBIC), rng)


def _follow_rays(at: Float32, heights: Float32, under: Float32, altitude_px: float) -> Float32:
    """Where rays towards positions ``at`` (H, W, 2) of the flat ground meet the surface first.

    A ray to ``at`` from above ``under`` is at height t over ``at + (under - at) t / altitude``.
    """
    towards = (under - at) / np.float32(altitude_px)
    reach = float(np.linalg.norm(towards, axis=-1).max())
    highest = float(heights.max())
    reached = np.zeros(at.shape[:2], np.float32)
    for height in np.linspace(0, highest, max(round(highest * reach / _MARCH_PX), 1) + 1).astype(np.float32):
        # From the ground upwards: the last hit is the one nearest to the camera.
        hit = cv2.remap(heights, at + towards * height, None, cv2.INTER_NEAREST) >= height
        reached[hit] = height
    return np.asarray(at + towards * reached[..., np.newaxis], dtype=np.float32)
