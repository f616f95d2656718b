"""The command that checks a flight takes what places a flight."""

from pathlib import Path

import cv2

from sim.scene import make_lawnmower
from skymosaic.cli.check import check
from skymosaic.cli.session import session


def test_positions_from_a_file_are_those_that_are_checked(tmp_path: Path) -> None:
    (tmp_path / "flight").mkdir()
    lines = ["EPSG:4326"]
    for number, image in enumerate(make_lawnmower(seed=9, images=3, size=(320, 240)).images):
        cv2.imwrite(str(tmp_path / "flight" / f"{number}.png"), image)
        lines.append(f"{number}.png {7 + number / 1000} 46")
    (tmp_path / "geo.txt").write_text("\n".join(lines))
    for positions, known in ((None, False), (tmp_path / "geo.txt", True)):
        check(photographs=[str(tmp_path / "flight")], positions=positions, cache=tmp_path / "cache")
        assert [each["gps"] for each in session.numbers["photographs"]] == [known] * 3
