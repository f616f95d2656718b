"""Results of the workers: numbers, records and addresses of pictures, but no pixels, so that little is pickled."""

import uuid
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple, Self

from golden_model.arrays import Array
from golden_model.text import one_line
from skymosaic.evaluation.hardware import Comparison
from skymosaic.panel.options import Options
from skymosaic.registration.pair import Pair
from skymosaic.tracking.output import TrackedCorners

Size = tuple[int, int]
RULES, EDITED_RULES = "rules.fll", "edited_rules.fll"
"""The rules of a run, and those that were tried afterwards."""
SINGLE_FILES = (
    "report/index.html", "tiles/index.html", "mosaic.png", "mosaic.tif", "tracked.mp4", "matches.csv", "corners.csv",
    "hardware.json", "config.toml", RULES, EDITED_RULES,
)  # fmt: skip
"""Pages and files of a run that are offered singly; the archive contains these and all others."""
GAP_PX = 12
"""Gap between pictures in a row, in viewer pixels."""


@dataclass(frozen=True, eq=False)
class Decoded:
    """A photograph, or a video's first frame, that was decoded."""

    size: Size
    """Width and height of the original, px."""
    notes: tuple[str, ...]
    """What was done to its pixels, or a video's frame rate."""
    working: Path
    """The picture as the front end sees it, from `new_picture`."""
    working_size: Size


@dataclass(eq=False)
class InputFile:
    """A file that a run can take: an upload that was accepted, or a photograph of an opened folder."""

    path: str
    """As a run names it: an upload's sanitised, unique name, or where a folder's photograph lies."""
    thumbnail: Path
    """Picture for lists; that of a folder's photograph is made while the folder is read."""
    decoded: Decoded | None = None
    """None for a folder's photograph, until it is one of the first two."""

    @classmethod
    def of_upload(cls, path: str, decoded: Decoded) -> Self:
        """The upload that was decoded."""
        return cls(path, decoded.working, decoded)

    @property
    def name(self) -> str:
        """The file's name without its folder, as pages show it."""
        return shown_name(self.path)

    @property
    def is_upload(self) -> bool:
        """Whether the session keeps the file, and removes it; a folder's photographs are only read."""
        return not Path(self.path).is_absolute()


def shown_name(path: str) -> str:
    """A file's name without its folder, of printable characters: other names need not be text in UTF-8."""
    return one_line(Path(path).name)


def new_picture(pictures: Path) -> Path:
    """Where a picture for the page is saved: never used again for another, and harmless in an address."""
    return pictures / f"{uuid.uuid4().hex}.png"


def picture_address(path: Path) -> str:
    """The address at which a page finds a picture."""
    return f"/picture/{path.parent.name}/{path.name}"


@dataclass(frozen=True)
class Picture:
    """A picture in a viewer: its size and top left corner in viewer pixels, and viewer pixels per pixel of it."""

    href: str
    width: float
    height: float
    x: float = 0
    y: float = 0
    scale: float = 1


def side_by_side(pictures: Iterable[tuple[Path, Size]]) -> tuple[Picture, ...]:
    """Put pictures in a row, `GAP_PX` apart."""
    placed: list[Picture] = []
    for path, size in pictures:
        before = placed[-1].x + placed[-1].width + GAP_PX if placed else 0
        placed.append(Picture(picture_address(path), *size, before))
    return tuple(placed)


@dataclass(frozen=True)
class ShownMosaic:
    """A mosaic as the page shows it."""

    picture: Picture
    """Reduced if the mosaic is large."""
    size: Size
    """Size of the whole mosaic, px."""
    outlines: dict[str, Array]
    """Corners (4, 2) of each photograph placed, by its name, in pixels of the picture."""
    seams: tuple[Array, ...] = ()
    """Closed lines (N, 2) around what each photograph shows, in pixels of the picture; empty where they are blended."""
    tiles: tuple[Picture, ...] = ()
    """Parts of the mosaic in more detail; empty where the picture shows everything."""


class Link(NamedTuple):
    """The names of two linked photographs of a flight, and the inliers of their registration."""

    left: str
    right: str
    inliers: int


def find_inside(folder: Path, path: str) -> Path | None:
    """A file of a folder; None for whatever lies elsewhere, links followed, so that no request can read it."""
    with suppress(OSError, ValueError):
        file = (folder / path).resolve()
        return file if file.is_relative_to(folder.resolve()) and file.is_file() else None
    return None


@dataclass(frozen=True)
class Run:
    """A finished run."""

    folder: Path
    """Everything the run used and wrote; it goes into the archive."""
    pictures: Path
    """Folder with what the page shows of it, the working pictures of its photographs among them."""
    command: str
    """The command line that repeats it."""


@dataclass(frozen=True)
class MosaicResult(Run):
    """A finished run of the mosaic page."""

    options: Options
    paths: dict[str, str]
    """Path of each photograph, relative to ``folder`` or absolute, by its name."""
    pair: Pair
    """The pair that is shown, without pixels; of a flight, one of its pairs."""
    working: tuple[Picture, ...]
    """What the front end saw of that pair, side by side."""
    seconds: dict[str, float]
    """Wall time of each stage."""
    reason: str = ""
    """Why there is no mosaic."""
    mosaic: ShownMosaic | None = None
    left_out: dict[str, str] = field(default_factory=dict)
    """Why photographs were not placed, by their names."""
    links: tuple[Link, ...] = ()
    """The pairs of a flight that can be shown, the one with the most inliers first."""
    facts: dict[str, str] = field(default_factory=dict)
    """Numbers of the whole mosaic, by name."""
    problems: dict[str, tuple[str, ...]] = field(default_factory=dict)
    """What `skymosaic check` says about photographs of a flight, by their names."""

    @property
    def pair_names(self) -> tuple[str, str]:
        """Left and right photograph of the pair that is shown."""
        return self.pair.left.name, self.pair.right.name


class HardwareResult(NamedTuple):
    """A pair computed by the golden model and by a backend, and the command line that repeats it."""

    backend: str
    comparison: Comparison
    command: str


@dataclass(frozen=True)
class TrackingResult(Run):
    """An object followed through a video."""

    video: Path
    """The video with the outline drawn in."""
    rows: tuple[TrackedCorners, ...]
    """Corners and matches of every frame."""
    seconds_per_frame: float
    notes: tuple[str, ...]
    """Faults in the video."""
