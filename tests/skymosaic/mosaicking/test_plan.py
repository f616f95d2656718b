"""From photographs to mosaics: what is read a second time is what was read first."""

from collections.abc import Callable
from pathlib import Path

import cv2
import pytest

from sim.scene import Flight
from skymosaic.common.errors import InputError
from skymosaic.mosaicking.api import open_plan
from skymosaic.mosaicking.options import MosaicOptions


def swap(one: Path, other: Path) -> None:
    """Let two files change their names."""
    one.rename(one.with_suffix(".tmp"))
    other.rename(one)
    one.with_suffix(".tmp").rename(other)


@pytest.fixture
def folder(flight: Flight, tmp_path: Path) -> Path:
    for number, image in enumerate(flight.images):
        cv2.imwrite(str(tmp_path / f"{number}.png"), image)
    return tmp_path


@pytest.mark.parametrize(
    ("stage", "change", "reasons"),
    [
        ("lens", lambda folder: (folder / "4.png").unlink(), {4: "was removed"}),
        ("layout", lambda folder: (folder / "4.png").write_bytes(b"another"), {4: "was replaced"}),
        ("layout", lambda folder: swap(folder / "1.png", folder / "7.png"), {1: "was replaced", 7: "was replaced"}),
        ("layout", lambda folder: (folder / "4.png").touch(), {}),
    ],
)
def test_a_photograph_that_changes_after_its_features_is_left_out_by_name(
    folder: Path, stage: str, change: Callable[[Path], None], reasons: dict[int, str]
) -> None:
    done: list[str] = []

    def progress(now: str, _done: int, _count: int) -> None:
        if now == stage and not done:
            done.append(now)
            change(folder)

    with open_plan(folder, MosaicOptions(), progress) as plan:
        left_out, (layout,) = plan.flight.left_out, plan.layouts
        assert {index: reason.split(": ", 1)[1][: len(reasons[index])] for index, reason in left_out.items()} == reasons
        assert all(reason.startswith(f"{folder / str(index)}.png: ") for index, reason in left_out.items())
        assert set(layout.members) == set(range(9)) - set(reasons)
        assert plan.mosaic(layout).image.any()


def test_a_photograph_that_changes_while_the_picture_is_made_ends_it(folder: Path) -> None:
    with open_plan(folder, MosaicOptions()) as plan:
        layout = plan.layouts[0]
        swap(folder / "1.png", folder / "7.png")
        with pytest.raises(InputError, match=r"[17]\.png: was replaced after it had been read; make the mosaic again"):
            plan.mosaic(layout)
