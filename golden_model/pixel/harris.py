"""The Harris corner measure (thesis, equations III-6 and III-7) in integers.

Bounds for smoothed gradients and a 5x5 window: the length of a gradient is at most 821.5 for any image, including the
rounding of the smoothing, so A + B <= 65 899 and |C| <= (A + B) / 2. With k < 1/4 the determinant and the penalty stay
below 2**31. Unsmoothed gradients reach a length of 1140.4; therefore they are limited to the 3x3 window, where
A + B <= 45 720.
"""

import numpy as np
from numpy.typing import NDArray

from golden_model.formats import encode_response
from golden_model.pixel.window import box_sum

TENSOR_SHIFT = 8

Gradient = NDArray[np.int16]
Plane = NDArray[np.int32]


def structure_tensor(gradient_x: Gradient, gradient_y: Gradient, window_px: int) -> tuple[Plane, Plane, Plane]:
    """Windowed sums of gradient products, ``>> 8`` (floor).

    Parameters
    ----------
    gradient_x, gradient_y : ndarray of int16, shape (H, W)
        `golden_model.formats.GRADIENT`.
    window_px : {3, 5}
        Side of the box.

    Returns
    -------
    a, b, c : ndarray of int32, shape (H, W)
        Sums of Ix**2, Iy**2 (`TENSOR_DIAGONAL`) and Ix Iy (`TENSOR_MIXED`). Unspecified within ``window_px // 2`` px
        of the border of the region where the gradients are specified.
    """

    def windowed(first: Gradient, second: Gradient) -> Plane:
        return box_sum(np.multiply(first, second, dtype=np.int32), window_px) >> TENSOR_SHIFT

    return windowed(gradient_x, gradient_x), windowed(gradient_y, gradient_y), windowed(gradient_x, gradient_y)


def raw_response(a: Plane, b: Plane, c: Plane, k_numerator: int, k_shift: int) -> Plane:
    """``R = A B - C**2 - ((k_numerator (A + B)**2) >> k_shift)`` (floor).

    Parameters
    ----------
    a, b, c : ndarray of int32, shape (H, W)
    k_numerator, k_shift : int
        k = k_numerator / 2**k_shift, below 1/4.

    Returns
    -------
    ndarray of int32, shape (H, W)
        `golden_model.formats.RAW_RESPONSE`; it never saturates (see the module's bounds).
    """
    # (A + B)**2 needs 33 bits. The denominator of k is a power of two, so the product is exact in float64. It is not
    # negative, so truncation is the floor.
    penalty = (a + b).astype(np.float64)
    np.square(penalty, out=penalty)
    penalty *= k_numerator / (1 << k_shift)
    raw = a * b
    raw -= c * c
    raw -= penalty.astype(np.int32)
    return raw


def response_code(raw: Plane, threshold: int) -> NDArray[np.uint16]:
    """Responses as 15-bit codes, the form in which they are used from here on; 0 below the threshold.

    Parameters
    ----------
    raw : ndarray of int32, shape (H, W)
        R.
    threshold : int
        Smallest R that survives. It is cut to its 11 leading bits like R itself, because codes are compared.

    Returns
    -------
    ndarray of uint16, shape (H, W)
        `golden_model.formats.RESPONSE_CODE`.
    """
    # Compared as codes, like everything that follows, and as the hardware does.
    code = encode_response(np.maximum(raw, 0))
    code *= code >= encode_response(np.array(threshold))
    return code
