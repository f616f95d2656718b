"""Runs of the mosaic page: the command line beside a result repeats it."""

import csv
import json
import re
import shlex
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest
from typer.testing import CliRunner

from golden_model.version import VERSION
from sim.backends.interface import Mismatch
from sim.scene import make_lawnmower, make_pair
from skymosaic.cli.commands import app
from skymosaic.panel.options import Options
from skymosaic.panel.tasks.mosaic_tasks import _choose_output, compare_hardware, look_at_pair, make_mosaic
from skymosaic.registration.register import register
from tests.made import write_located, write_pictures

METRES_PER_PIXEL = 0.15


def silent(_line: str, _done: int = 0, _total: int = 0) -> None:
    """No progress is shown."""


OPTIONS: dict[str, dict[str, Any]] = {
    "preset": {},
    "threshold": {"position": 26, "rules": "none", "blending": "average", "damaged": "keep"},
    "fast": {"detector": "fast", "position": 25, "descriptor": "ilbp-256", "estimator": "fuzzy-ransac"},
    "key points": {"detector": "brisk", "descriptor": "freak", "estimator": "magsac", "accept_poor": True},
    "fewer key points": {"detector": "orb", "position": 16, "blending": "multiband"},
}


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """The folder of a run for each of `OPTIONS`."""
    images = make_pair(seed=9, size=(320, 240)).images
    folders = {name: tmp_path_factory.mktemp("run") for name in OPTIONS}
    for name, folder in folders.items():
        options = Options.of_preset("aerial")
        for option, value in OPTIONS[name].items():
            options = options.changed(option, value)
        (folder / "pictures").mkdir()
        write_pictures(folder, images)
        result = make_mosaic(folder, ["0.png", "1.png"], options, folder / "pictures", progress=silent)
        assert result.mosaic is not None, result.reason
    return folders


@pytest.mark.parametrize("name", OPTIONS)
def test_the_command_of_a_pair_repeats_its_mosaic(
    runs: dict[str, Path], name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(runs[name])
    before = Path("mosaic.png").rename("before.png")
    program, *arguments = shlex.split(Path("command.txt").read_text())
    assert program == "skymosaic"
    result = CliRunner().invoke(app, arguments)
    assert result.exception is None, result.output
    assert np.array_equal(np.asarray(cv2.imread("mosaic.png")), np.asarray(cv2.imread(str(before))))


def test_every_option_changes_the_mosaic_and_no_file_names_its_folder(runs: dict[str, Path]) -> None:
    """Otherwise a command that ignored the options would pass the test above."""
    assert len({(folder / "mosaic.png").read_bytes() for folder in runs.values()}) == len(runs)
    # The archive is opened elsewhere and must not reveal where the panel keeps its files.
    for folder in runs.values():
        texts = [path for path in folder.rglob("*") if path.suffix in (".csv", ".html", ".json", ".toml", ".txt")]
        assert len(texts) == 6
        assert not any(str(folder) in path.read_text() for path in texts)


def test_the_file_of_matches_is_the_table_of_the_pair(runs: dict[str, Path]) -> None:
    folder = runs["preset"]
    pair = register(folder / "0.png", folder / "1.png")
    with (folder / "matches.csv").open() as file:
        rows = list(csv.DictReader(file))
    for name in ("left_x", "left_y", "right_x", "right_y", "error_px", "weight"):
        np.testing.assert_array_equal([float(row[name]) for row in rows], pair.table("matches")[name])
    assert [row["verdict"] for row in rows].count("inlier") == len(pair.inliers) > 0
    with (folder / "corners.csv").open() as file:
        corners = list(csv.DictReader(file))
    assert [row["image"] for row in corners] == [f"{n}.png" for n, each in enumerate(pair.features) for _ in each]
    found = np.concatenate(pair.features)
    for name, values in (("x", found["x"] / 16), ("y", found["y"] / 16), ("sector", found["sector"])):
        np.testing.assert_array_equal([float(row[name]) for row in corners], values)


def test_a_damaged_photograph_that_is_kept_is_compared_too(tmp_path: Path) -> None:
    images = make_pair(seed=9, size=(400, 300)).images
    for number, image in enumerate(images):
        cv2.imwrite(str(tmp_path / f"{number}.jpg"), image)
    data = bytearray((tmp_path / "0.jpg").read_bytes())
    data[len(data) // 2 : len(data) // 2 + 400] = bytes(400)
    (tmp_path / "0.jpg").write_bytes(data)
    options = Options.of_preset("aerial").changed("damaged", "keep")
    # The model itself stands in for the hardware.
    result = compare_hardware(tmp_path, ("0.jpg", "1.jpg"), options, "golden", progress=silent)
    assert result.comparison.mismatch is None
    assert "--damaged keep" in result.command
    written = json.loads((tmp_path / "hardware.json").read_text())
    assert (written["version"], written["mismatch"]) == (VERSION, None)
    assert (
        replace(result.comparison, mismatch=Mismatch(1, "gray", 3.0, 4.0, 7, 8)).summary()["mismatch"].endswith("got 8")
    )


def test_photographs_with_gps_become_a_geotiff_and_name_their_place(tmp_path: Path) -> None:
    names = write_flight_with_gps(tmp_path)
    (tmp_path / "pictures").mkdir()
    result = make_mosaic(tmp_path, names, Options.of_preset("aerial"), tmp_path / "pictures", progress=silent)
    assert "-o mosaic.tif --tiles tiles" in result.command
    report = (tmp_path / "report" / "index.html").read_text()
    for beside in ("../mosaic.tif", "../tiles/index.html"):
        assert f'href="{beside}"' in report
        assert (tmp_path / "report" / beside).is_file()
    assert list((tmp_path / "tiles").glob("*/*/*.webp"))
    assert not {"contradiction", "not written"}.intersection(result.facts)
    assert re.match(r"EPSG:32632, 0\.1\d* m per pixel; GPS residual", result.facts["map"])
    assert result.facts["photographs placed"] == "4 of 4"
    assert re.match(rf"{len(result.links)} of \d+ tried", result.facts["pairs linked"])
    assert "blending and writing" in result.seconds
    inliers = [link.inliers for link in result.links]
    assert inliers == sorted(inliers, reverse=True)
    assert result.pair_names == result.links[0][:2]
    other = result.links[-1][:2]
    shown = look_at_pair(tmp_path, result, other, progress=silent)
    assert shown.pair_names == other
    assert {each.href for each in shown.working}.isdisjoint(each.href for each in result.working)
    assert [(each.width, each.height, each.x) for each in shown.working] == [(400, 300, 0), (400, 300, 412)]


def write_flight_with_gps(folder: Path) -> list[str]:
    """Four photographs, each with the position above which it was taken; returns their names."""
    rendered = make_lawnmower(seed=9, images=4, size=(400, 300))
    names = [f"DJI_{number}.jpg" for number in range(len(rendered.images))]
    for name, image, pose in zip(names, rendered.images, rendered.poses, strict=True):
        moved_m = METRES_PER_PIXEL * pose.x_px, -METRES_PER_PIXEL * pose.y_px
        write_located(folder / name, image, (46.0, 7.0), moved_m)
    return names


@pytest.mark.parametrize(
    ("bands", "located", "output"),
    [
        (("green", "red"), "0000", ["mosaic.tif"]),
        ((), "0000", ["mosaic.png"]),
        ((), "1100", ["mosaic.png"]),
        ((), "0111", ["mosaic.tif", "--tiles", "tiles"]),
        ((), "01", ["mosaic.png"]),
        ((), "11", ["mosaic.tif", "--tiles", "tiles"]),
    ],
)
def test_where_enough_photographs_have_a_place_the_mosaic_is_a_map(
    bands: tuple[str, ...], located: str, output: list[str]
) -> None:
    views = [SimpleNamespace(gps="here" if each == "1" else None) for each in located]
    plan: Any = SimpleNamespace(sources=[SimpleNamespace(bands=bands)], flight=SimpleNamespace(views=views))
    assert _choose_output(plan) == output
