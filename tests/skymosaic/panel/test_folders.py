"""Folders outside of the roots stay closed, by whatever path or link they are asked for."""

from pathlib import Path

import pytest

from skymosaic.common.errors import InputError
from skymosaic.panel.folders import Roots
from tests.skymosaic.panel.visitor import noise_png


@pytest.fixture
def root(tmp_path: Path) -> Path:
    """A root with a flight, beside a folder that is none of it."""
    for folder in ("root/flight", "root/.hidden", "outside", "root with more"):
        (tmp_path / folder).mkdir(parents=True)
    for folder in ("root/flight", "outside"):
        for number in (10, 2):
            (tmp_path / folder / f"DJI_{number}.png").write_bytes(noise_png(96, number))
    return tmp_path / "root"


def test_photographs_inside_are_listed_as_by_every_command(root: Path) -> None:
    roots = Roots([root])
    folder = roots.find_folder("flight")
    assert folder == roots.find_folder(str(root / "flight" / ".." / "flight")) == root / "flight"
    assert [path.name for path in roots.list_photographs(folder).pictures] == ["DJI_2.png", "DJI_10.png"]
    assert roots.list_folders(folder) == [root]
    assert roots.list_folders(root) == [root / "flight"]


@pytest.mark.parametrize(
    "path",
    ["..", "flight/../../outside", "{top}/outside", "{top}/root with more", "/", "/etc", "/no such folder", "~root",
     "link", "link/../outside", "{top}/root/link", "\0", "flight\0", "x" * 5000, "loop", "~no such user/x"],
)  # fmt: skip
def test_no_path_leads_out(root: Path, path: str) -> None:
    (root / "link").symlink_to(root.parent / "outside")
    (root / "loop").symlink_to(root / "loop")
    roots = Roots([root])
    with pytest.raises(InputError) as refused:
        roots.find_folder(path.format(top=root.parent))
    assert "\n" not in str(refused.value)
    assert root / "link" not in roots.list_folders(root)


def test_a_photograph_that_is_a_link_out_is_refused_by_name(root: Path) -> None:
    roots = Roots([root])
    (root / "flight" / "inside.png").symlink_to("DJI_2.png")
    assert len(roots.list_photographs(root / "flight").pictures) == 3
    (root / "flight" / "secret.png").symlink_to(root.parent / "outside" / "DJI_2.png")
    with pytest.raises(InputError, match=r"secret\.png: a link that leads out"):
        roots.list_photographs(root / "flight")


def test_a_folder_without_pictures_says_what_to_do(root: Path) -> None:
    roots = Roots([root, root.parent / "outside"])
    for folder, says in (
        (root / ".hidden", "open another folder"),
        (root, r"2 .* inside \(flight\): open one of them"),
    ):
        with pytest.raises(InputError, match=f"contains no pictures; {says}$"):
            roots.list_photographs(folder)
    # Each of the roots may be opened, a relative path is below the first.
    assert roots.find_folder(str(root.parent / "outside")) == root.parent / "outside"
    assert roots.find_folder("flight") == root / "flight"


def test_outside_of_the_roots_one_cannot_ask_what_exists(root: Path) -> None:
    """The refusal is the same for a folder that exists and one that does not."""
    refusals = []
    for name in ("outside", "nowhere"):
        with pytest.raises(InputError) as refused:
            Roots([root]).find_folder(str(root.parent / name))
        refusals.append(str(refused.value).replace(f"/{name}", ""))
    assert refusals[0] == refusals[1]


def test_a_link_to_a_root_is_the_root(root: Path) -> None:
    (root.parent / "link").symlink_to(root)
    assert Roots([root.parent / "link"]).find_folder("flight") == root / "flight"
