"""The pages of the reports, as a person reads them: no folders, no raw keys, the worst photographs first."""

import re
from html import unescape

import cv2
import pytest

from sim.scene import make_lawnmower
from skymosaic.mosaicking.api import open_plan
from skymosaic.mosaicking.options import MosaicOptions
from skymosaic.reports.flight import _common_folder, write_report


@pytest.fixture(scope="module")
def pages(tmp_path_factory: pytest.TempPathFactory) -> dict[int, str]:
    """The report's page of two and of six photographs, as text."""
    folder = tmp_path_factory.mktemp("flight")
    paths = [folder / f"IMG_{number}.png" for number in range(6)]
    for path, image in zip(paths, make_lawnmower(3, 6, (400, 300)).images, strict=True):
        cv2.imwrite(str(path), image)
    texts = {}
    for count in (2, 6):
        with open_plan(paths[:count], MosaicOptions()) as plan:
            write_report(folder / "report", plan.flight, plan.write(folder / "mosaic.tif", overwrite=True))
        page = (folder / "report" / "index.html").read_text()
        assert str(folder) not in page
        texts[count] = unescape(re.sub(r"<[^>]+>", "\n", page[page.index("<main>") :]))
    return texts


@pytest.mark.parametrize("count", [2, 6])
def test_no_page_shows_raw_keys_or_values(pages: dict[int, str], count: int) -> None:
    assert re.findall(r"\b[a-z]+_[a-z_]+\b|True|False|None|\{|\}", pages[count]) == []


def test_the_worst_photographs_of_a_flight_come_first(pages: dict[int, str]) -> None:
    rows = pages[6].partition("Photographs, worst first")[2].split("links, worst first")[0]
    errors = [float(error) for error in re.findall(r"IMG_\d\.png\s+([\d.]+)", rows)]
    assert len(errors) > 3
    assert errors == sorted(errors, reverse=True)


def test_the_page_of_a_pair_has_the_words_of_the_command_line(pages: dict[int, str]) -> None:
    for words in ("IMG_0.png, 400x300 px", "accepted", "on the homography", "harris + ilbp-128, prosac", "good: "):
        assert words in pages[2]


@pytest.mark.parametrize(
    ("names", "folder"),
    [
        (["/flight/1.jpg", "/flight/rtk/2.jpg"], "/flight/"),
        (["flight/1.jpg", "flight/2.jpg"], "flight/"),
        (["1.jpg", "2.jpg"], ""),
        (["north/1.jpg", "south/2.jpg"], ""),
        (["/flight/1.jpg", "2.jpg"], ""),
    ],
)
def test_names_lose_only_the_folder_that_has_all_of_them(names: list[str], folder: str) -> None:
    assert _common_folder(names) == folder
