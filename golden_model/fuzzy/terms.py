"""Shapes of fuzzy sets over a real axis."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from golden_model.arrays import Array, Mask


@dataclass(frozen=True)
class Term:
    """A fuzzy set.

    Parameters
    ----------
    name : str
    shape : str
        A key of `SHAPES`.
    parameters : tuple of float
        Positions on the axis, as FuzzyLite's terms of that name take them:

        - ``Ramp``: where the degree is 0, where it is 1; it falls where the second is smaller;
        - ``Triangle``, ``Trapezoid``: corners from left to right; an outer corner may be infinite;
        - ``Rectangle``: first and last position of degree 1;
        - ``Sigmoid``: position of degree 1/2, slope;
        - ``Discrete``: x and degree in turn, with x rising; between them straight lines, beyond them the end's degree.

    Raises
    ------
    ValueError
        For an unknown shape, a wrong number of parameters, or positions out of order.
    """

    name: str
    shape: str
    parameters: tuple[float, ...]

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
        if self.shape == "Ramp" and self.parameters[0] == self.parameters[1]:
            raise ValueError(f"term {self.name}: a Ramp needs two different positions")

    def degree(self, x: Array) -> Array:
        """Compute the degree of membership at each position, 0 to 1."""
        return SHAPES[self.shape][1](np.asarray(x, dtype=np.float64), *self.parameters)


def _ramp(x: Array, zero_at: float, one_at: float) -> Array:
    return np.clip((x - zero_at) / (one_at - zero_at), 0.0, 1.0)


def _triangle(x: Array, left: float, top: float, right: float) -> Array:
    return _trapezoid(x, left, top, top, right)


def _trapezoid(x: Array, left: float, from_: float, to: float, right: float) -> Array:
    rising = _edge(x >= from_, x, left, from_)
    falling = _edge(x <= to, -x, -right, -to)
    return np.minimum(rising, falling)


def _edge(inside: Mask, x: Array, zero_at: float, one_at: float) -> Array:
    """1 where ``inside``, elsewhere the edge that leads there: vertical, or flat if it starts at infinity."""
    if np.isinf(zero_at):
        return np.ones_like(x)
    return inside.astype(np.float64) if zero_at == one_at else np.where(inside, 1.0, _ramp(x, zero_at, one_at))


def _rectangle(x: Array, first: float, last: float) -> Array:
    return ((x >= first) & (x <= last)).astype(np.float64)


def _sigmoid(x: Array, centre: float, slope: float) -> Array:
    # Beyond 700 the exponential overflows, and the degree is 0 or 1 in any case.
    return 1.0 / (1.0 + np.exp(np.clip(-slope * (x - centre), -700.0, 700.0)))


def _discrete(x: Array, *points: float) -> Array:
    xs, ys = np.array(points[::2]), np.array(points[1::2])
    degree = np.interp(x, xs, ys)
    # A vertical edge belongs to its upper end.
    for position in xs[1:][np.diff(xs) == 0]:
        degree = np.where(x == position, ys[xs == position].max(), degree)
    return np.asarray(degree)


SHAPES: dict[str, tuple[int, Callable[..., Array]]] = {
    "Ramp": (2, _ramp),
    "Triangle": (3, _triangle),
    "Trapezoid": (4, _trapezoid),
    "Rectangle": (2, _rectangle),
    "Sigmoid": (2, _sigmoid),
    "Discrete": (0, _discrete),
}
"""Number of parameters (0: any) and membership function of each shape."""
ORDERED = ("Triangle", "Trapezoid", "Rectangle", "Discrete")
