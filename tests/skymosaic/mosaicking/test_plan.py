"""From photographs to mosaics: what is read a second time is what was read first."""

import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest

from sim.scene import Flight
from skymosaic.common.errors import InputError, RegistrationError
from skymosaic.mosaicking.api import open_plan
from skymosaic.mosaicking.options import MosaicOptions
from skymosaic.mosaicking.plan import MosaicPlan


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
        mosaic = next(plan.mosaics())
    assert {
        index: reason.split(": ", 1)[1][: len(reasons[index])] for index, reason in mosaic.left_out.items()
    } == reasons
    assert all(reason.startswith(f"{folder / str(index)}.png: ") for index, reason in mosaic.left_out.items())
    assert set(mosaic.placed) == set(range(9)) - set(reasons)
    assert mosaic.image.any()


def test_a_photograph_that_changes_while_the_picture_is_made_is_left_out_by_name(
    folder: Path, tmp_path_factory: pytest.TempPathFactory
) -> None:
    """The picture begins anew, and is what it is without the photograph from the start."""
    output, told = tmp_path_factory.mktemp("made") / "m.png", list[dict[int, str]]()
    reason = f"{folder / '1.png'}: was replaced after it had been read"

    def progress(stage: str, _done: int, _count: int) -> None:
        if stage == "exposure and seams" and told:
            shutil.copy(folder / "7.png", folder / "1.png")

    with open_plan(folder, MosaicOptions(), progress) as plan:
        plan.flight = plan.flight.without({1: reason})
        expected = next(plan.mosaics())
        del plan.flight
        (delivery,) = plan.write(output, on_absent=lambda absent: told.append(dict(absent)))
    assert told == [{}, {1: reason}]
    assert expected.left_out == delivery.flight.left_out == {1: reason}
    assert np.array_equal(np.asarray(cv2.imread(str(output))), expected.image)


def test_where_all_photographs_change_there_is_no_mosaic(folder: Path, tmp_path: Path) -> None:
    with open_plan(folder, MosaicOptions()) as plan:
        assert plan.layouts
        for path in folder.glob("*.png"):
            path.unlink()
        with pytest.raises(RegistrationError, match=r"no two photographs make a mosaic; .*0.png: was removed after it"):
            plan.write(tmp_path / "m.tif")
        assert not any(tmp_path.iterdir())


def test_all_groups_are_written_where_that_is_wanted(flight: Flight, tmp_path: Path) -> None:
    # Nothing links mirrored ground to the other photographs.
    small = [cv2.resize(image[:, ::-1], (320, 240), interpolation=cv2.INTER_AREA) for image in flight.images[:3]]
    told: list[dict[int, str]] = []
    with open_plan([*small, *flight.images[:3]], MosaicOptions()) as plan:
        one = plan.write(tmp_path / "one.png", on_absent=lambda absent: told.append(dict(absent)))
        plan.options = replace(plan.options, all_groups=True)
        both = plan.write(tmp_path / "all.png", on_absent=lambda absent: told.append(dict(absent)))
    written = [[each.path.name for each in made] for made in (one, both)]
    assert written == [["one.png"], ["all.png", "all_2.png"]]
    assert {path.name for path in tmp_path.iterdir()} == {"one.png", "all.png", "all_2.png"}
    assert (tmp_path / "one.png").read_bytes() == (tmp_path / "all.png").read_bytes()
    assert [list(absent) for absent in told] == [[0, 1, 2], []]


def test_control_points_must_reach_the_largest_group_and_no_other(monkeypatch: pytest.MonkeyPatch) -> None:
    def place(*_: Any) -> None:
        raise InputError("too few control points")

    monkeypatch.setattr("skymosaic.mosaicking.plan.place_on_map", place)
    first, second = object(), object()
    plan: Any = SimpleNamespace(layouts=[first, second], flight=None, options=MosaicOptions())
    with pytest.raises(InputError, match="too few"):
        MosaicPlan._place(plan, first)  # type: ignore[arg-type]
    assert MosaicPlan._place(plan, second).note == "too few control points"  # type: ignore[arg-type]
