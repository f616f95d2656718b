"""Tables: a row for each match, pair and photograph, in columns that keep their types."""

import csv
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from sim.scene import make_lawnmower, make_pair
from skymosaic import extract, mosaic, register, register_pairs, table_of_pairs
from skymosaic.common.errors import InputError
from skymosaic.common.tables import Table, tabulate
from skymosaic.registration.pair import Pair
from tests.skymosaic.panel.tasks.test_mosaic_tasks import write_flight_with_gps


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("flight")
    elsewhere = make_pair(seed=9, size=(320, 240)).images[0]
    for number, image in enumerate([*make_lawnmower(1, 3, (320, 240)).images, elsewhere]):
        cv2.imwrite(str(made / f"{number}.png"), image)
    return made


@pytest.fixture(scope="module")
def pairs(folder: Path) -> list[Pair]:
    return register_pairs(folder, [(0, 1), (0, 3), (2, 1)], effort="fast")


def types(table: Table) -> str:
    """The kind of each column: text, boolean, integer or float."""
    assert len({column.shape for column in table.values()}) == 1
    return "".join(column.dtype.kind for column in table.values())


def test_pairs_are_those_of_register_with_names_and_progress(folder: Path, pairs: list[Pair]) -> None:
    alone = register(folder / "2.png", folder / "1.png", effort="fast")
    np.testing.assert_array_equal(pairs[2].homography, alone.homography)
    assert [Path(pairs[2].left.name).name, Path(pairs[2].right.name).name] == ["2.png", "1.png"]
    assert not pairs[2].left.pixels.size
    assert pairs[2].left.size == pairs[2].right.size == (320, 240)
    assert pairs[2].summary()["left"] == alone.summary()["left"] == str(folder / "2.png")
    seen: list[tuple[str, int, int]] = []
    every_two = register_pairs(f"{folder}/[012].png", detector="orb", progress=lambda *stage: seen.append(stage))
    assert [(Path(each.left.name).stem, Path(each.right.name).stem) for each in every_two] == [
        ("0", "1"), ("0", "2"), ("1", "2"),
    ]  # fmt: skip
    assert seen[-1] == ("pairs", 3, 3)
    with pytest.raises(InputError, match=r"none\.png: no such file"):
        register_pairs([folder / "none.png", folder / "0.png"])


@pytest.mark.parametrize("pair", [(0, 4), ("0.png", "1.png"), (0.0, 1.0), (0, 1, 2), 0])
def test_pairs_that_are_none_are_refused_before_anything_is_read(pair: Any) -> None:
    with pytest.raises(InputError, match="numbers of two photographs for each, 0 to 3"):
        register_pairs(["absent.png"] * 4, [pair])


def test_results_are_found_in_lists_and_are_keys(folder: Path, pairs: list[Pair]) -> None:
    features = [extract(folder / f"{number}.png") for number in range(2)]
    mosaics = [mosaic([folder / "0.png", folder / "1.png"]) for _ in range(2)]
    every: list[list[Any]] = [[*pairs], [*features], [*mosaics]]
    for results in every:
        assert results.index(results[-1]) == len(set(results)) - 1


def test_a_pair_with_itself_is_the_same_picture(folder: Path, pairs: list[Pair]) -> None:
    (same,) = register_pairs([folder / "0.png", folder / "0.png"])
    assert "the same picture as" in same.summary()["notes"][0]
    assert pairs[0].summary()["notes"] == []


def test_a_table_of_pairs_has_a_row_each(pairs: list[Pair], tmp_path: Path) -> None:
    table = table_of_pairs(pairs)
    assert types(table) == "UUbUUf" + "i" * 7 + "b" + "f" * 10
    assert table["accepted"].tolist() == [True, False, True]
    assert "inliers" in table["reason"][1]
    for row, pair in enumerate(pairs):
        entries = [table[f"h{i}{j}"][row] for i in (1, 2, 3) for j in (1, 2, 3)]
        if pair.homography is None:
            assert np.isnan(entries).all()
        else:
            np.testing.assert_array_equal(entries, pair.homography.ravel())
    with (tmp_path / "pairs.csv").open("w", newline="") as file:
        csv.writer(file).writerows([table, *zip(*table.values(), strict=True)])
    with (tmp_path / "pairs.csv").open() as file:
        assert [int(row["inliers"]) for row in csv.DictReader(file)] == [len(pair.inliers) for pair in pairs]


def test_a_table_of_matches_has_original_pixels_and_errors(pairs: list[Pair]) -> None:
    table = pairs[0].table()
    assert types(table) == "ffffffU"
    assert len(table["rule"]) == len(pairs[0].inliers)
    assert 0 < table["error_px"].max() < 2.1
    refused = pairs[1].table("matches")
    assert len(refused["left_x"]) == len(pairs[1].matches) > 0
    assert np.isnan(refused["error_px"]).all()


def test_a_table_of_photographs_has_all_that_were_given(tmp_path: Path) -> None:
    write_flight_with_gps(tmp_path)
    (tmp_path / "0_note.png").write_bytes(b"no picture")
    made = mosaic(tmp_path)
    table = made.table()
    assert types(table) == "UbUffffifffbff"
    assert table["photograph"][0].endswith("0_note.png")
    assert table["placed"].tolist() == [False, True, True, True, True]
    assert "not an image" in table["reason"][0]
    assert np.isnan([table["x_px"][0], table["map_x"][0], table["sharpness"][0]]).all()
    height_px, width_px = made.image.shape[:2]
    assert repr(made) == f"Mosaic({width_px}x{height_px} px, 4 photographs, 1 left out)"
    assert ((table["x_px"][1:] > 0) & (table["x_px"][1:] < width_px)).all()
    assert ((table["y_px"][1:] > 0) & (table["y_px"][1:] < height_px)).all()
    place = made.composition.place.georeference
    assert place is not None
    # The photographs lie on the map as they do on the canvas, north up.
    metres, pixels = np.ptp(table["map_x"][1:]), np.ptp(table["x_px"][1:])
    assert metres == pytest.approx(pixels * place.metres_per_pixel, rel=1e-6)
    assert np.argmin(table["map_y"][1:]) == np.argmax(table["y_px"][1:])
    assert table["gps"].tolist() == [False, True, True, True, True]


def test_nothing_makes_an_empty_table_and_none_is_not_a_number() -> None:
    assert tabulate([]) == {}
    table = tabulate([{"a": None, "b": 1}, {"a": 2.5, "b": 2}])
    assert np.isnan(table["a"][0])
    assert table["b"].dtype.kind == "i"
