"""Converts the colours of photographs to sRGB, in which mosaics are, by the profile in the file."""

import io
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image as PillowImage
from PIL import ImageCms

from golden_model.text import one_line

PROFILE = "colour profile"
"""How the notes about profiles begin."""
_ROWS = 256
"""Rows that are converted at a time: each step is a copy."""


def convert_to_srgb(pixels: NDArray[Any], profile: bytes) -> str:
    """Convert BGR (H, W, 3) of 8 bits in place; returns a note about what was done, or why nothing was; or empty."""
    transform, name = _open_transform(profile)
    if transform is None or pixels.ndim != 3:
        return name and f"{PROFILE} {name}: the colours are taken for sRGB"
    if pixels.dtype != np.uint8:
        return f"{PROFILE} {name}: only 8 bits are converted to sRGB; they stay as they are"
    for top in range(0, len(pixels), _ROWS):
        rows = PillowImage.fromarray(np.ascontiguousarray(pixels[top : top + _ROWS, :, ::-1]))
        pixels[top : top + _ROWS] = np.asarray(transform.apply(rows))[..., ::-1]
    return f"{PROFILE} {name}: converted to sRGB"


@lru_cache(maxsize=8)
def _open_transform(profile: bytes) -> tuple[ImageCms.ImageCmsTransform | None, str]:
    """What converts RGB of a profile, and the profile's name; neither for sRGB itself, or of gray and CMYK."""
    try:
        given = ImageCms.ImageCmsProfile(io.BytesIO(profile))
        name = one_line(ImageCms.getProfileDescription(given).strip())
        if given.profile.xcolor_space.strip() != "RGB" or "srgb" in name.lower():
            return None, ""
        return ImageCms.buildTransform(given, ImageCms.createProfile("sRGB"), "RGB", "RGB"), name
    # It is data of unknown origin.
    except (ImageCms.PyCMSError, OSError, ValueError, TypeError):
        return None, "that is damaged"
