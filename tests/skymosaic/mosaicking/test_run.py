"""From photographs to mosaics: what is read a second time is what was read first."""

import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from PIL import Image as PillowImage

from sim.scene import Flight
from skymosaic.common.errors import InputError, RegistrationError
from skymosaic.flight.layout.layout import Layout
from skymosaic.flight.picture import formats
from skymosaic.flight.picture.formats import format_of
from skymosaic.imagery.exif import Metadata
from skymosaic.imagery.images import load
from skymosaic.imagery.photographs import Source, list_sources
from skymosaic.maps.boundary import OutsideError
from skymosaic.mosaicking.api import open_run
from skymosaic.mosaicking.options import MosaicOptions
from skymosaic.mosaicking.result import Mosaic
from skymosaic.mosaicking.run import MosaicRun, lay_out
from skymosaic.running.workers import Workers
from tests.skymosaic.flight import made

PHOTOGRAPH = Source(0, "0.jpg", Path("0.jpg"))


def swap(one: Path, other: Path) -> None:
    """Let two files change their names."""
    one.rename(one.with_suffix(".tmp"))
    other.rename(one)
    one.with_suffix(".tmp").rename(other)


@pytest.fixture
def folder(flight: Flight, tmp_path: Path) -> Path:
    for number, image in enumerate(flight.images[:5]):
        cv2.imwrite(str(tmp_path / f"{number}.png"), image)
    return tmp_path


@pytest.mark.parametrize(
    ("stage", "change", "reasons"),
    [
        ("lens", lambda folder: (folder / "4.png").unlink(), {4: "was removed"}),
        ("layout", lambda folder: swap(folder / "3.png", folder / "4.png"), {3: "was replaced", 4: "was replaced"}),
        ("layout", lambda folder: (folder / "4.png").touch(), {}),
    ],
)
def test_a_photograph_that_changes_after_its_features_is_left_out_by_name(
    folder: Path, surveyed: Path, stage: str, change: Callable[[Path], None], reasons: dict[int, str]
) -> None:
    done: list[str] = []

    def progress(now: str, _done: int, _count: int) -> None:
        if now == stage and not done:
            done.append(now)
            change(folder)

    with open_run(folder, MosaicOptions(cache=surveyed), progress) as run:
        mosaic = next(run.mosaics())
    assert {
        index: reason.split(": ", 1)[1][: len(reasons[index])] for index, reason in mosaic.left_out.items()
    } == reasons
    assert all(reason.startswith(f"{folder / str(index)}.png: ") for index, reason in mosaic.left_out.items())
    assert set(mosaic.placed) == set(range(5)) - set(reasons)
    assert mosaic.image.any()


def test_pages_that_are_not_read_and_several_days_are_told_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    page = PillowImage.new("RGB", (80, 80))
    for number in range(3):
        page.save(tmp_path / f"{number}.tif", save_all=True, append_images=[page] * number)
    told: list[str] = []
    photographs = [load(source.name) for source in list_sources(tmp_path)]
    taken = [Metadata(time=f"2026-0{month}-12 10:00:00") for month in (1, 1, 6)]
    pairs = zip(photographs, taken, strict=True)
    read = made.flight([made.view(each.name, notes=each.notes, taken=how) for each, how in pairs])
    monkeypatch.setattr("skymosaic.mosaicking.run.survey", lambda *_, **__: read)
    with Workers() as workers:
        lay_out([], MosaicOptions(), workers, told.append)
    assert told == [
        f"note {tmp_path / '1.tif'}: only the first of 2 pages is read (2 such files)",
        "note taken on 2 days (2 of 2026-01-12, 1 of 2026-06-12): "
        "what has changed between them shows in patches; make a mosaic of each day",
    ]


def test_a_photograph_that_changes_while_the_picture_is_made_is_left_out_by_name(
    folder: Path, surveyed: Path, tmp_path_factory: pytest.TempPathFactory
) -> None:
    """The picture begins anew, and is what it is without the photograph from the start."""
    output, told = tmp_path_factory.mktemp("made") / "m.png", list[dict[int, str]]()
    reason = f"{folder / '0.png'}: was replaced after it had been read"

    def progress(stage: str, _done: int, _count: int) -> None:
        if stage == "exposure and seams" and told:
            shutil.copy(folder / "4.png", folder / "0.png")

    with open_run(folder, MosaicOptions(cache=surveyed), progress) as run:
        without = MosaicRun(run.sources, run.options, run._workers, print, run.flight.without({0: reason}))
        expected = next(without.mosaics())
        (delivery,) = run.write(output, on_absent=lambda absent: told.append(dict(absent)))
    assert told == [{}, {0: reason}]
    assert expected.left_out == delivery.flight.left_out == {0: reason}
    assert np.array_equal(np.asarray(cv2.imread(str(output))), expected.image)


def test_where_all_photographs_change_there_is_no_mosaic(folder: Path, surveyed: Path, tmp_path: Path) -> None:
    with open_run(folder, MosaicOptions(cache=surveyed)) as run:
        assert run.layouts
        for path in folder.glob("*.png"):
            path.unlink()
        with pytest.raises(RegistrationError, match=r"no two photographs make a mosaic; .*0.png: was removed after it"):
            run.write(tmp_path / "m.tif")
        assert not any(tmp_path.iterdir())


def test_all_groups_are_written_where_that_is_wanted(
    flight: Flight, surveyed: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The group with most pixels comes first: wide and thermal pictures of one drone may be in any order."""
    # Nothing links mirrored ground to the other photographs.
    small = [cv2.resize(image[:, ::-1], (320, 240), interpolation=cv2.INTER_AREA) for image in flight.images[:3]]
    told, lines, outside = list[dict[int, str]](), list[str](), list[Layout]()

    def compose_inside(run: MosaicRun, layout: Layout, *path: Path) -> Any:
        if layout in outside:
            raise OutsideError("a.kml: no photograph shows any of it")
        return compose(run, layout, *path)

    compose = MosaicRun.composition
    monkeypatch.setattr(MosaicRun, "composition", compose_inside)
    with open_run([*small, *flight.images[:3]], MosaicOptions(cache=surveyed), tell=lines.append) as run:
        one = run.write(tmp_path / "one.png", on_absent=lambda absent: told.append(dict(absent)))
        run.options = replace(run.options, all_groups=True)
        both = run.write(tmp_path / "all.png", on_absent=lambda absent: told.append(dict(absent)))
        outside.append(run.layouts[0])
        second, (other,) = run.write(tmp_path / "second.png"), run.mosaics()
        outside.append(run.layouts[1])
        with pytest.raises(OutsideError, match="no photograph shows any of it"):
            run.write(tmp_path / "none.png")
        with pytest.raises(OutsideError, match="no photograph shows any of it"):
            next(run.mosaics())
    written = [[each.path.name for each in made] for made in (one, both, second)]
    assert written == [["one.png"], ["all.png", "all_2.png"], ["second.png"]]
    assert other.placed == (0, 1, 2)
    assert lines == ["note: a group is left out: a.kml: no photograph shows any of it"] * 3
    assert {path.name for path in tmp_path.iterdir()} == {"one.png", "all.png", "all_2.png", "second.png"}
    assert (tmp_path / "one.png").read_bytes() == (tmp_path / "all.png").read_bytes()
    assert [list(absent) for absent in told] == [[0, 1, 2], []]


def test_what_a_file_cannot_hold_is_refused_or_reduced_before_it_is_rendered(
    flight: Flight, surveyed: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of two photographs it is refused; the canvas of a flight is reduced, whatever area was asked for."""
    small = replace(format_of(Path("m.webp")), max_side_px=300)
    monkeypatch.setitem(formats._BY_SUFFIX, ".webp", small)
    rendered = list[object]()
    monkeypatch.setattr(MosaicRun, "bands", lambda _, composition: rendered.append(composition))
    refused = pytest.raises(
        InputError, match=r"m\.webp: \d+x\d+ cannot be stored as \.webp, whose sides have at most 300"
    )
    with open_run(flight.images[:2], MosaicOptions()) as run:
        with refused:
            run.write(tmp_path / "m.webp")
        image = np.zeros((4, 400), np.uint8)
        mosaic = Mosaic(image, run.flight, run.layouts[0], run.composition(run.layouts[0]))
        with refused:
            mosaic.save(tmp_path / "m.webp")
    assert not rendered
    with open_run(flight.images[:3], MosaicOptions(cache=surveyed, canvas_limit_px=9_000_000)) as run:
        composition = run.composition(run.layouts[0], tmp_path / "m.webp")
    assert 290 < max(composition.size) <= 300
    assert "because the limit is 9 megapixels, with sides of at most 300 px; `scale`" in composition.reduced
    assert not any(tmp_path.iterdir())


def test_control_points_must_reach_the_largest_group_and_no_other(monkeypatch: pytest.MonkeyPatch) -> None:
    def place_on_map(*_: Any) -> None:
        raise InputError("too few control points")

    monkeypatch.setattr("skymosaic.mosaicking.run.place_on_map", place_on_map)
    monkeypatch.setattr("skymosaic.mosaicking.run.compose", lambda *_, **given: given["place"])
    first, second = (Layout(members, members[0], {}, ()) for members in ((0, 1), (2, 3)))
    with Workers() as workers:
        run = MosaicRun(
            [PHOTOGRAPH] * 4, MosaicOptions(), workers, print, made.flight(made.views(4), (), [first, second])
        )
        with pytest.raises(InputError, match="too few"):
            run.composition(first)
        place: Any = run.composition(second)
    assert place.note == "too few control points"
