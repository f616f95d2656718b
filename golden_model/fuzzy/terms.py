"""Shapes of fuzzy sets over a real axis."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from golden_model.arrays import Array, Mask


@dataclass(frozen=True)
class Term:
    """A fuzzy set.

    Raises
    ------
    ValueError
        For an unknown shape, a wrong number of parameters, or positions out of order.
    """

    name: str
    shape: str
    """A key of `SHAPES`."""
    parameters: tuple[float, ...]
    """Positions on the axis, as FuzzyLite's terms of that name take them:

    - ``Ramp``: where the degree is 0, where it is 1; it falls where the second is smaller;
    - ``Triangle``, ``Trapezoid``: corners from left to right; an outer corner may be infinite;
    - ``Rectangle``: first and last position of degree 1;
    - ``ZShape``, ``SShape``: from where to where it falls or rises, in two parabolas; ``PiShape``: an S, then a Z;
    - ``Gaussian``: mean, standard deviation; ``GaussianProduct``: these of the left and of the right flank;
    - ``Bell``: centre, half width at degree 1/2, slope; ``Cosine``, ``Spike``: centre, width;
    - ``Sigmoid``: position of degree 1/2, slope; ``SigmoidDifference``, ``SigmoidProduct``: position and slope of the
      left one, slope and position of the right one;
    - ``Discrete``: x and degree in turn, with x rising; between them straight lines, beyond them the end's degree.
    """

    def __post_init__(self) -> None:
        if self.shape not in SHAPES:
            raise ValueError(f"term {self.name}: shape {self.shape} is not known; valid: {', '.join(SHAPES)}")
        count, _ = SHAPES[self.shape]
        given = len(self.parameters)
        if given != count if count else given < 4 or given % 2:
            needed = count or "at least two points of two"
            raise ValueError(f"term {self.name}: {self.shape} takes {needed} numbers, not {given}")
        if np.isnan(self.parameters).any():
            raise ValueError(f"term {self.name}: a parameter is not a number")
        positions = self.parameters[::2] if self.shape == "Discrete" else self.parameters
        if self.shape in ORDERED and list(positions) != sorted(positions):
            raise ValueError(f"term {self.name}: {self.shape} needs rising positions, not {positions}")
        if self.shape in ("Ramp", "ZShape", "SShape") and self.parameters[0] == self.parameters[1]:
            raise ValueError(f"term {self.name}: {self.shape} needs two different positions")
        if any(self.parameters[index] == 0 for index in WIDTHS.get(self.shape, ())):
            raise ValueError(f"term {self.name}: {self.shape} has a width of 0")

    def degree(self, x: Array) -> Array:
        """Compute the degree of membership at each position, 0 to 1."""
        return SHAPES[self.shape][1](np.asarray(x, dtype=np.float64), *self.parameters)


def _ramp(x: Array, zero_at: float, one_at: float) -> Array:
    return np.clip((x - zero_at) / (one_at - zero_at), 0.0, 1.0)


def _trapezoid(x: Array, left: float, from_: float, to: float, right: float) -> Array:
    rising = _edge(x >= from_, x, left, from_)
    falling = _edge(x <= to, -x, -right, -to)
    return np.minimum(rising, falling)


def _edge(inside: Mask, x: Array, zero_at: float, one_at: float) -> Array:
    """1 where ``inside``, elsewhere the edge that leads there: vertical, or flat if it starts at infinity."""
    if np.isinf(zero_at):
        return np.ones_like(x)
    return inside.astype(np.float64) if zero_at == one_at else np.where(inside, 1.0, _ramp(x, zero_at, one_at))


def _sigmoid(x: Array, centre: float, slope: float) -> Array:
    # Beyond 700 the exponential overflows, and the degree is 0 or 1 in any case.
    return 1.0 / (1.0 + np.exp(np.clip(-slope * (x - centre), -700.0, 700.0)))


def _s_shape(x: Array, start: float, end: float) -> Array:
    share = np.clip((x - start) / (end - start), 0.0, 1.0)
    return np.where(share <= 0.5, 2 * share**2, 1 - 2 * (1 - share) ** 2)


def _z_shape(x: Array, start: float, end: float) -> Array:
    return 1 - _s_shape(x, start, end)


def _pi_shape(x: Array, bottom_left: float, top_left: float, top_right: float, bottom_right: float) -> Array:
    # An edge of no width is vertical; as in FuzzyLite, the left one starts beyond its position.
    rising = _s_shape(x, bottom_left, top_left) if bottom_left < top_left else (x > top_left).astype(np.float64)
    falling = _z_shape(x, top_right, bottom_right) if top_right < bottom_right else (x <= top_right).astype(np.float64)
    return rising * falling


def _gaussian(x: Array, mean: float, deviation: float) -> Array:
    return np.exp(-((x - mean) ** 2) / (2 * deviation**2))


def _gaussian_product(x: Array, mean_a: float, deviation_a: float, mean_b: float, deviation_b: float) -> Array:
    return _gaussian(np.minimum(x, mean_a), mean_a, deviation_a) * _gaussian(np.maximum(x, mean_b), mean_b, deviation_b)


def _bell(x: Array, centre: float, width: float, slope: float) -> Array:
    with np.errstate(over="ignore", divide="ignore"):
        return 1 / (1 + np.abs((x - centre) / width) ** (2 * slope))


def _cosine(x: Array, centre: float, width: float) -> Array:
    # Half a period to either side.
    return (1 + np.cos(np.clip(2 * np.pi / width * (x - centre), -np.pi, np.pi))) / 2


def _discrete(x: Array, *points: float) -> Array:
    xs, ys = np.array(points[::2]), np.array(points[1::2])
    degree = np.interp(x, xs, ys)
    # A vertical edge belongs to its upper end.
    for position in xs[1:][np.diff(xs) == 0]:
        degree = np.where(x == position, ys[xs == position].max(), degree)
    return np.asarray(degree)


SHAPES: dict[str, tuple[int, Callable[..., Array]]] = {
    "Ramp": (2, _ramp),
    "Triangle": (3, lambda x, left, top, right: _trapezoid(x, left, top, top, right)),
    "Trapezoid": (4, _trapezoid),
    "Rectangle": (2, lambda x, first, last: ((x >= first) & (x <= last)).astype(np.float64)),
    "ZShape": (2, _z_shape),
    "SShape": (2, _s_shape),
    "PiShape": (4, _pi_shape),
    "Gaussian": (2, _gaussian),
    "GaussianProduct": (4, _gaussian_product),
    "Bell": (3, _bell),
    "Cosine": (2, _cosine),
    "Spike": (2, lambda x, centre, width: np.exp(-np.abs(10 / width * (x - centre)))),
    "Sigmoid": (2, _sigmoid),
    "SigmoidDifference": (4, lambda x, a, up, down, b: np.abs(_sigmoid(x, a, up) - _sigmoid(x, b, down))),
    "SigmoidProduct": (4, lambda x, a, up, down, b: _sigmoid(x, a, up) * _sigmoid(x, b, down)),
    "Discrete": (0, _discrete),
}
"""Number of parameters (0: any) and membership function of each shape."""
ORDERED = ("Triangle", "Trapezoid", "Rectangle", "ZShape", "SShape", "PiShape", "Discrete")
WIDTHS = {"Gaussian": (1,), "GaussianProduct": (1, 3), "Bell": (1,), "Cosine": (1,), "Spike": (1,)}
"""Parameters that are divided by."""
