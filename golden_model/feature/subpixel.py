"""Sub-pixel corner positions: a parabola through three responses, separately in x and y."""

import numpy as np
from numpy.typing import NDArray

from golden_model.formats import POSITION, decode_response


def vertex(before: NDArray[np.int32], centre: NDArray[np.int32], after: NDArray[np.int32]) -> NDArray[np.int64]:
    """Vertex of the parabola through three equidistant values, relative to the middle one.

    With u = centre - after and v = centre - before, the exact vertex is (v - u) / (2 (u + v)). It is rounded to the
    nearest 1/16, halves away from zero; it is 0 where the three values are equal.

    Parameters
    ----------
    before, centre, after : ndarray of int32, shape (N,)
        Decoded responses; ``centre`` must be at least as large as both others.

    Returns
    -------
    ndarray of int64, shape (N,)
        In 1/16 px, -8 to 8.
    """
    u = centre.astype(np.int64) - after
    v = centre.astype(np.int64) - before
    # Adding the half before the floor division rounds the magnitude; the sign is put back afterwards.
    total = u + v
    magnitude: NDArray[np.int64] = (POSITION.one * np.abs(v - u) + total) // np.maximum(2 * total, 1)
    return np.sign(v - u) * magnitude


def refine(
    code: NDArray[np.uint16], x: NDArray[np.intp], y: NDArray[np.intp], level: int
) -> tuple[NDArray[np.uint16], NDArray[np.uint16]]:
    """Refine corners to sub-pixel positions in the full-resolution frame.

    The centre of half-size pixel x is at 2 (x + 1/2) - 1/2 in the full frame.

    Parameters
    ----------
    code : ndarray of uint16, shape (H, W)
        Response codes of the level before suppression, `golden_model.formats.RESPONSE_CODE`.
    x, y : ndarray of int, shape (N,)
        Corners in the level's pixels, not on its outermost rows and columns.
    level : {0, 1}

    Returns
    -------
    x, y : ndarray of uint16, shape (N,)
        `golden_model.formats.POSITION`, in 1/16 px.
    """
    centre = decode_response(code[y, x])
    offset_x = vertex(decode_response(code[y, x - 1]), centre, decode_response(code[y, x + 1]))
    offset_y = vertex(decode_response(code[y - 1, x]), centre, decode_response(code[y + 1, x]))
    return _full_resolution(x, offset_x, level), _full_resolution(y, offset_y, level)


def _full_resolution(position: NDArray[np.intp], offset: NDArray[np.int64], level: int) -> NDArray[np.uint16]:
    # A half-size offset counts twice, so level 1 has positions in steps of 1/8 px.
    fine = POSITION.one * position + offset
    half_px = POSITION.one // 2
    return (fine if level == 0 else 2 * fine + half_px).astype(np.uint16)
