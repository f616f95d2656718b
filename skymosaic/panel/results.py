"""What the workers return: numbers, records and paths of pictures, but no pixels, so that little is pickled."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from golden_model.arrays import Array
from skymosaic.evaluation.hardware import Comparison
from skymosaic.panel.options import Options
from skymosaic.panel.pair_view import PairView, Size
from skymosaic.tracking.output import TrackedCorners

SINGLE_FILES = (
    "mosaic.png", "mosaic.tif", "tracked.mp4", "matches.csv", "corners.csv", "hardware.json", "config.toml",
)  # fmt: skip
"""What a run may write that is of use by itself; the archive has the rest, too."""


def picture_name(name: str) -> str:
    """The name of the picture that the page shows of an uploaded file."""
    return f"{name}.png"


@dataclass(frozen=True)
class Upload:
    """An uploaded file that was accepted.

    Attributes
    ----------
    name : str
        Of the file in the session's folder: its own, as far as it is free and harmless.
    size : (int, int)
        Width and height of the original, px.
    notes : tuple of str
        What was done to its pixels, or a video's frame rate.
    working : Path
        The picture as the front end sees it (PNG).
    working_size : (int, int)
    """

    name: str
    size: Size
    notes: tuple[str, ...]
    working: Path
    working_size: Size

    @property
    def pictures(self) -> list[Path]:
        """The pictures that the page shows of it."""
        return [self.working]


@dataclass(frozen=True)
class Tile:
    """A part of a mosaic in more detail than its picture has.

    Attributes
    ----------
    picture : Path
    scale : float
        Pixels of the mosaic's picture a pixel of the tile, below 1.
    x, y, width, height : float
        In pixels of the mosaic's picture.
    """

    picture: Path
    scale: float
    x: float
    y: float
    width: float
    height: float


@dataclass(frozen=True)
class ShownMosaic:
    """A mosaic as the page shows it.

    Attributes
    ----------
    picture : Path
        Reduced if the mosaic is large.
    size : (int, int)
        Of the whole mosaic, px.
    shown_size : (int, int)
    outlines : dict of str to (4, 2) ndarray
        Corners of each photograph placed, by its name, in pixels of the picture.
    seams : tuple of (N, 2) ndarray
        Closed lines around what each photograph shows, in pixels of the picture; empty where they are blended.
    tiles : tuple of Tile
        Empty where the picture shows everything.
    """

    picture: Path
    size: Size
    shown_size: Size
    outlines: dict[str, Array]
    seams: tuple[Array, ...] = ()
    tiles: tuple[Tile, ...] = ()


@dataclass(frozen=True)
class MapView:
    """A georeferenced mosaic as the page's map shows it.

    Attributes
    ----------
    picture : Path
        PNG in the projection of web maps, transparent where there is no ground.
    bounds : (float, float, float, float)
        South, west, north, east, in degrees.
    outlines : dict of str to list of (float, float)
        Corners of each photograph as latitude and longitude, by its name.
    crs : str
        The coordinate system of the GeoTIFF.
    grid_m : float
        Distance of the lines of the grid.
    """

    picture: Path
    bounds: tuple[float, float, float, float]
    outlines: dict[str, list[tuple[float, float]]]
    crs: str
    grid_m: float


@dataclass(frozen=True)
class LinkView:
    """The names of two photographs of a flight that were linked, and the inliers of their registration."""

    names: tuple[str, str]
    inliers: int


@dataclass(frozen=True)
class MosaicResult:
    """A finished run of the mosaic page.

    Attributes
    ----------
    folder : Path
        Everything the run used and wrote; it goes into the archive.
    options : Options
        The options of the run.
    working_pictures : tuple of Path
        Working pictures of the photographs, in their order.
    pair : PairView
        The pair that is shown; of a flight, one of its pairs.
    mosaic : ShownMosaic or None
        None if none could be made; ``reason`` says why.
    left_out : dict of str to str
        Why photographs were not placed, by their names.
    command : str
        The command line that repeats it.
    seconds : dict of str to float
        Wall time of each stage.
    links : tuple of LinkView
        The pairs of a flight that can be shown, the one with the most inliers first.
    facts : dict of str to str
        Numbers of a whole flight, by name; empty for a pair.
    problems : dict of str to tuple of str
        What `skymosaic check` says about photographs of a flight, by their names.
    map : MapView or None
        None if the mosaic has no place on a map.
    """

    folder: Path
    options: Options
    working_pictures: tuple[Path, ...]
    pair: PairView
    mosaic: ShownMosaic | None
    left_out: dict[str, str]
    reason: str
    command: str
    seconds: dict[str, float]
    links: tuple[LinkView, ...] = ()
    facts: dict[str, str] = field(default_factory=dict)
    problems: dict[str, tuple[str, ...]] = field(default_factory=dict)
    map: MapView | None = None

    @property
    def files(self) -> list[Path]:
        """The files that can be downloaded one by one."""
        return [path for name in SINGLE_FILES if (path := self.folder / name).exists()]

    @property
    def on_accelerator(self) -> bool:
        """Whether the accelerator can compute these features."""
        return self.options.choose_method()[0].on_accelerator

    @property
    def pictures(self) -> list[Path]:
        """The pictures that the page shows of it."""
        shown = [view.picture for view in (self.mosaic, self.map) if view]
        tiles = [tile.picture for tile in self.mosaic.tiles] if self.mosaic else []
        return [*self.working_pictures, *shown, *tiles]


@dataclass(frozen=True)
class HardwareResult:
    """A pair computed by the golden model and by hardware.

    Attributes
    ----------
    names : (str, str)
        Of the photographs.
    size : (int, int)
        Of the larger frame, px.
    backend : str
        Name of the hardware backend.
    comparison : Comparison
    software_seconds : float
        Time of the golden model for features and matches of both.
    command : str
        The command line that repeats the comparison.
    """

    names: tuple[str, str]
    size: Size
    backend: str
    comparison: Comparison
    software_seconds: float
    command: str


@dataclass(frozen=True)
class TrackingResult:
    """An object followed through a video.

    Attributes
    ----------
    folder : Path
        Everything the run used and wrote.
    video : Path
        The video with the outline drawn in.
    rows : tuple of TrackedCorners
        Corners and matches of every frame.
    seconds_per_frame : float
    notes : tuple of str
        Faults found in the video.
    command : str
        The command line that repeats it.
    """

    folder: Path
    video: Path
    rows: tuple[TrackedCorners, ...]
    seconds_per_frame: float
    notes: tuple[str, ...]
    command: str

    @property
    def pictures(self) -> list[Path]:
        """The pictures that the page shows of it."""
        return [self.video]

    @property
    def files(self) -> list[Path]:
        """The files that can be downloaded one by one."""
        return [path for name in SINGLE_FILES if (path := self.folder / name).exists()]
