from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from PIL import Image

from skymosaic.common.errors import InputError
from skymosaic.imagery.band_writer import write_png


def bands_of(picture: np.ndarray, rows: int = 64) -> list[np.ndarray]:
    return [picture[top : top + rows] for top in range(0, len(picture), rows)]


def noise(height: int, width: int, *channels: int) -> np.ndarray:
    return np.random.default_rng(1).integers(0, 256, (height, width, *channels), dtype=np.uint8)


@pytest.mark.parametrize("channels", [(), (3,)], ids=["gray", "bgr"])
def test_bands_read_back_as_the_picture(tmp_path: Path, channels: tuple[Any, ...]) -> None:
    picture = noise(150, 67, *channels)
    path = tmp_path / "picture.png"
    write_png(path, (67, 150), len(channels) * 2 + 1, bands_of(picture))
    np.testing.assert_array_equal(cv2.imread(str(path), cv2.IMREAD_UNCHANGED), picture)
    with Image.open(path) as opened:
        rgb = np.asarray(opened)
    np.testing.assert_array_equal(rgb, picture[..., ::-1] if channels else picture)


def test_a_full_disk_leaves_one_line_and_no_file(tmp_path: Path) -> None:
    def disk_fills() -> Iterator[Any]:
        yield noise(64, 67)
        raise OSError(28, "No space left on device")

    with pytest.raises(InputError, match="No space left on device"):
        write_png(tmp_path / "picture.png", (67, 150), 1, disk_fills())
    assert list(tmp_path.iterdir()) == []
