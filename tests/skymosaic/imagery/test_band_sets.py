"""Which files of a folder are the bands of a capture, which photographs, and which band registers the flight."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from skymosaic.common.errors import InputError
from skymosaic.imagery.band_sets import group_band_sets, select_band
from skymosaic.imagery.photographs import Source, list_sources


def sources_of(folder: Path, *names: str) -> list[Source]:
    """Sources of small files of 16 bits."""
    for name in names:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        cv2.imwrite(str(folder / name), np.zeros((70, 80), np.uint16))
    return list_sources([folder / name for name in names])


def grouped(sources: list[Source], band: str | None = None) -> list[list[str]]:
    """The registering file of each capture, and the bands."""
    return [[Path(source.name).name, *source.bands] for source in group_band_sets(sources, band)]


def fault_of(capture: Source) -> str:
    """Why a capture cannot be read; empty if it can."""
    try:
        _ = capture.digest, [band.digest for band in capture.bands.values()]
    except InputError as error:
        return str(error)
    return ""


def three(*endings: str) -> list[str]:
    """Names of three captures."""
    return [f"IMG_{number:04}_{ending}" for number in (10, 11, 12) for ending in endings]


@pytest.mark.parametrize(
    ("names", "registering", "bands"),
    [
        (three("1.tif", "2.tif", "10.tif"), "2.tif", ["1", "2", "10"]),
        (three("03.tiff", "4.TIF"), "03.tiff", ["3", "4"]),
        (three("NIR.TIF", "red.tif", "GRE.TIF", "reg.jpg"), "GRE.TIF", ["green", "red", "red edge", "nir"]),
        (three("NIR.TIF", "BLU.TIF"), "BLU.TIF", ["blue", "nir"]),
        (three("RedEdge.tif", "5.tif", "green.tif"), "green.tif", ["green", "red edge", "5"]),
        (three("D.JPG", "MS_G.TIF", "MS_NIR.TIF", "MS_RE.TIF"), "MS_G.TIF", ["green", "red edge", "nir"]),
    ],
)
def test_bands_are_told_by_the_ends_of_names(
    tmp_path: Path, names: list[str], registering: str, bands: list[str]
) -> None:
    found = group_band_sets(sources_of(tmp_path, *names))
    assert [[Path(each.name).name, *each.bands] for each in found] == [
        [f"IMG_{number:04}_{registering}", *bands] for number in (10, 11, 12)
    ]
    assert [source.index for source in found] == [0, 1, 2]
    for each, number in zip(found, (10, 11, 12), strict=True):
        assert all(f"IMG_{number:04}_" in file.name for file in each.files)


@pytest.mark.parametrize(
    "names",
    [
        three("1.tif", "2.tif")[:4],  # two captures only
        ["a_1.tif", "b_2.tif", "c_NIR.tif", "d_NIR.tif", "e_NIR.tif"],  # one band each
        three("1.jpg", "2.jpg"),  # no TIFF
        ["north/IMG_1_1.tif", "south/IMG_1_2.tif", "IMG_2_1.tif", "IMG_3_1.tif"],  # one name in two folders
    ],
)
def test_other_photographs_stay_as_they_are(tmp_path: Path, names: list[str]) -> None:
    sources = sources_of(tmp_path, *names)
    assert grouped(sources) == [[Path(source.name).name] for source in sources]
    assert select_band(sources, None) == sources
    with pytest.raises(InputError, match="`band` nir: the photographs are not multi-band sets; leave it out"):
        group_band_sets(sources, "nir")


def test_numbered_photographs_in_colour_are_no_bands(tmp_path: Path) -> None:
    names = [f"line{line}_{number:02}.tif" for line in (1, 2, 3) for number in (1, 2, 3)][:8]
    sources = sources_of(tmp_path, *names)
    told: list[str] = []
    captures = group_band_sets(sources, tell=told.append)
    assert fault_of(captures[2]).endswith(
        "line3_01.tif: its capture has no band 3, which 2 of 3 have; if the files are photographs, rename them, as "
        "line3-01.tif"
    )
    assert told == [
        f"note {tmp_path / 'line1_01.tif'}: 8 such files are read as 3 captures of bands 1, 2, 3; if the files are "
        "photographs, rename them, as line1-01.tif"
    ]
    with pytest.raises(InputError, match=r"`band` 2; if the files are photographs, rename them, as line1-01\.tif$"):
        select_band(sources, None)
    assert len(group_band_sets(sources, "3", tell=told.append)) == 3
    assert len(told) == 1
    for name in names:
        cv2.imwrite(str(tmp_path / name), np.zeros((70, 80, 3), np.uint8))
    assert group_band_sets(sources, tell=told.append) == select_band(sources, None) == sources
    assert len(told) == 1
    with pytest.raises(InputError, match="not multi-band sets"):
        group_band_sets(sources, "2")


def test_a_band_in_colour_is_refused_before_the_work(tmp_path: Path) -> None:
    sources = sources_of(tmp_path, *three("GRE.tif", "RED.tif"))
    cv2.imwrite(str(tmp_path / "IMG_0011_RED.tif"), np.zeros((70, 80, 3), np.uint8))
    with pytest.raises(InputError, match=r"IMG_0011_RED\.tif: in colour, but a band is gray"):
        group_band_sets(sources)


@pytest.mark.parametrize(("band", "ending"), [("red", "MS_R"), ("MS_R", "MS_R"), ("NIR", "MS_NIR"), ("nir", "MS_NIR")])
def test_a_named_band_registers(tmp_path: Path, band: str, ending: str) -> None:
    sources = sources_of(tmp_path, *three("MS_G.TIF", "MS_R.TIF", "MS_NIR.TIF"))
    assert [name for name, *_ in grouped(sources, band)] == three(f"{ending}.TIF")
    with pytest.raises(InputError, match="`band` blue: the sets have green, red, nir; name one of these"):
        grouped(sources, "blue")


def test_colour_pictures_are_left_out_and_said_to_be(tmp_path: Path) -> None:
    names = [name for name in three("GRE.tif", "NIR.tif", "RGB.jpg") if name != "IMG_0011_RGB.jpg"]
    told: list[str] = []
    found = group_band_sets(sources_of(tmp_path, *names), tell=told.append)
    assert [list(source.bands) for source in found] == [["green", "nir"]] * 3
    assert told == [f"note {tmp_path / 'IMG_0010_RGB.jpg'}: 2 colour pictures belong to no band and are not used"]


@pytest.mark.parametrize("stray", ["north/IMG_0010_RGB.jpg", "IMG_0013_RGB.jpg", "view.tif"])
def test_a_photograph_among_sets_is_refused(tmp_path: Path, stray: str) -> None:
    names = [*three("1.tif", "2.tif", "RGB.jpg"), stray]
    with pytest.raises(InputError, match=f"{stray}: belongs to no multi-band set, as the others do"):
        grouped(sources_of(tmp_path, *names))


def test_a_capture_that_lacks_a_band_is_left_out_by_a_file_that_it_has(tmp_path: Path) -> None:
    names = three("GRE.tif", "RED.TIF", "NIR.tif")
    kept = [name for name in names if name not in ("IMG_0011_RED.TIF", "IMG_0012_GRE.tif")]
    captures = group_band_sets(sources_of(tmp_path, *kept))
    assert [fault_of(capture).removeprefix(str(tmp_path)) for capture in captures] == [
        "",
        "/IMG_0011_GRE.tif: its capture has no band red, which 2 of 3 have",
        "/IMG_0012_RED.TIF: its capture has no band green, which 2 of 3 have",
    ]
    assert all(file.exists() for capture in captures for file in capture.files)


@pytest.mark.parametrize(
    ("names", "second", "band"),
    [(three("GRE.TIF", "NIR.TIF"), "IMG_0011_GRE.jpg", "green"), (three("1.tif", "2.tif"), "IMG_0011_01.tif", "1")],
)
def test_two_files_of_one_band_are_refused(tmp_path: Path, names: list[str], second: str, band: str) -> None:
    sources = sources_of(tmp_path, *names, second)
    says = rf"{names[2]} and .*{second}: both are band {band} of one capture; put one of them"
    with pytest.raises(InputError, match=says):
        group_band_sets(sources)
    with pytest.raises(InputError, match=says):
        select_band(sources, band)
    other = "nir" if band == "green" else "2"
    assert [Path(source.name).name for source in select_band(sources, other)] == names[1::2]
    # One file given twice is one file, and two captures are no sets.
    assert len(group_band_sets([*sources[:-1], sources[2]])) == 3
    assert len(group_band_sets([*sources[:4], sources[-1]])) == 5


def test_a_band_that_most_captures_lack_is_refused(tmp_path: Path) -> None:
    names = three("1.tif", "2.tif")
    with pytest.raises(InputError, match=r"IMG_0010_3\.tif: 2 of 3 captures have no band 3; put the files"):
        group_band_sets(sources_of(tmp_path, *names, "IMG_0010_3.tif"))
    # As many as have it; where more do, the others are left out.
    four = [*names, "IMG_0013_1.tif", "IMG_0013_2.tif", "IMG_0010_3.tif", "IMG_0011_3.tif"]
    with pytest.raises(InputError, match=r"IMG_0010_3\.tif: 2 of 4 captures have no band 3; put the files"):
        group_band_sets(sources_of(tmp_path, *four))
    assert len(group_band_sets(sources_of(tmp_path, *four, "IMG_0012_3.tif"))) == 4


@pytest.mark.parametrize("band", [2, 3])
def test_one_capture_of_several_that_has_another_size_is_refused(tmp_path: Path, band: int) -> None:
    names = three("1.tif", "2.tif", "3.tif")
    sources = sources_of(tmp_path, *names)
    cv2.imwrite(str(tmp_path / f"IMG_0012_{band}.tif"), np.zeros((70, 90), np.uint16))
    message = rf"IMG_0012_{band}\.tif: 90x70 pixels, but band 1 has 80x70; all bands need one"
    with pytest.raises(InputError, match=message):
        grouped(sources)
    Path(sources[-1].name).write_bytes(b"no picture")
    with pytest.raises(InputError, match=r"IMG_0012_3\.tif: .*, or remove all files of this capture"):
        grouped(sources)


def test_one_band_can_be_selected_also_where_captures_lack_it(tmp_path: Path) -> None:
    names = [name for name in three("GRE.tif", "RED.tif", "07.tif") if name != "IMG_0011_RED.tif"]
    sources = sources_of(tmp_path, *names)
    for band, ending in (("red", "RED.tif"), ("GREEN", "GRE.tif"), ("7", "07.tif"), ("07", "07.tif")):
        expected = [name for name in names if name.endswith(ending)]
        assert [Path(source.name).name for source in select_band(sources, band)] == expected
    with pytest.raises(InputError, match="`band` thermal: valid: blue, green, red, red edge, nir, or the number"):
        select_band(sources, "thermal")
    with pytest.raises(InputError, match=r"multi-band sets \(green, red, 7\); name the band to show: `band` green"):
        select_band(sources, None)
