"""The options of a mosaic, and which of them apply to two photographs and which to more."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

from skymosaic.common.errors import InputError
from skymosaic.common.options import INPUT, MACHINE, MAP, PICTURE, Checked, document_options, option, options_of
from skymosaic.compositing.blend import Blending
from skymosaic.features.given_matches import Given, GivenMatches
from skymosaic.flight.linking.links import Candidate
from skymosaic.flight.linking.view import Settings
from skymosaic.flight.picture.composition import MEMORY_BYTES
from skymosaic.imagery.lens import Lens, load_lens
from skymosaic.maps.base_map import BaseMap, load_base_map
from skymosaic.maps.boundary import Boundary, load_boundary
from skymosaic.maps.control_points import ControlPoints, load_control_points
from skymosaic.maps.positions import Positions, load_positions
from skymosaic.mosaicking.result import Mosaic
from skymosaic.registration.options import PhotographOptions, RegistrationOptions, Seeded

MEGABYTE = 1 << 20
MEGAPIXEL = 1_000_000
Warp = Literal["auto", "homography"]
LiveEstimator = Literal["prosac", "fabric"]


@dataclass(frozen=True, kw_only=True)
class FolderOptions(Checked):
    """Which pictures of a folder are read."""

    recursive: bool = option(False, "Read the folders inside a folder too.", INPUT)


@dataclass(frozen=True, kw_only=True)
class CanvasOptions(FolderOptions):
    """What is laid out, and how large it becomes: the same for a flight and for a live mosaic."""

    band: str | None = option(
        None, "Band of multi-band sets that registers the flight, by name or number: nir, 2.", INPUT
    )
    scale: float = option(1.0, "Canvas pixels per pixel of the reference photograph.", PICTURE, above=0, maximum=1)
    canvas_limit_px: int | None = option(
        None,
        "Maximum canvas size; by default what the file can hold.",
        PICTURE,
        unit=MEGAPIXEL,
        unit_name="megapixels",
        minimum=1,
    )


@document_options
@dataclass(frozen=True, kw_only=True)
class LiveOptions(CanvasOptions, Seeded, PhotographOptions):
    """How a mosaic grows while frames arrive."""

    estimator: LiveEstimator = option(
        "prosac", "Frames are linked by the host, or by a homography of each from the chip: fabric."
    )


@dataclass(frozen=True, kw_only=True)
class SurveyOptions(FolderOptions, Seeded, PhotographOptions):
    """How the photographs of a flight are linked and laid out."""

    lens: Lens | None = option(
        None,
        "Distortion and mask, the same for all photographs.",
        INPUT,
        read=load_lens,
        parts={
            "camera": "TOML file with intrinsics and distortion.",
            "mask": "Picture, black where photographs show no ground.",
        },
    )
    control_points: ControlPoints | None = option(
        None, "Ground control points instead of GPS, from OpenDroneMap's gcp_list.txt.", MAP, read=load_control_points
    )
    positions: Positions | None = option(
        None,
        "Positions of the cameras instead of GPS, from OpenDroneMap's geo.txt.",
        MAP,
        read=load_positions,
        not_for_two="two photographs stay in the frame of the right one",
    )
    onto: BaseMap | None = option(
        None,
        "Lay the mosaic onto this map, any georeferenced raster, in its system and on its grid; needs GPS.",
        MAP,
        read=load_base_map,
        not_for_two="two photographs stay in the frame of the right one",
    )
    boundary: Boundary | None = option(
        None, "End the map at the polygons of a .geojson or .kml file; needs GPS.", MAP, read=load_boundary
    )
    keep_all: bool = option(
        False,
        "Take pictures that differ from the others in size, kind, GPS and the like, as maps and contact sheets do.",
        INPUT,
        not_for_two="two photographs are taken as they are",
    )
    scheduler: str | None = option(None, "Dask scheduler, tcp://HOST:PORT or a scheduler file.", MACHINE)
    cache: Path | None = option(
        None,
        "Folder that keeps features and links of flights for the next run; by default in the user's cache, up to 2 GB.",
        MACHINE,
        not_for_two="two photographs are registered anew each time",
    )
    matches: Mapping[Candidate, Given] | None = None

    def read_matches(self, photographs: int) -> dict[Candidate, GivenMatches]:
        """Check the matches that are given; raises for other photographs, and as `GivenMatches.read`."""
        numbers, matches = set(range(photographs)), self.matches or {}
        for pair in matches:
            if not (len(pair) == 2 and numbers.issuperset(pair) and pair[0] < pair[1]):
                valid = f"two of 0 to {photographs - 1}, the smaller first"
                raise InputError(f"`matches` {pair}: a pair has the numbers of its photographs, {valid}")
        return {pair: GivenMatches.read(given, f"`matches` {pair}") for pair, given in matches.items()}

    def flight_settings(self) -> Settings:
        """How the features of a flight's photographs are computed."""
        return Settings(self.base_config, self.backend_name, self.working_width_px, self.lens or Lens())


@document_options
@dataclass(frozen=True, kw_only=True)
class MosaicOptions(CanvasOptions, SurveyOptions, RegistrationOptions):
    """How photographs become a mosaic. Each option applies, or `check_for` refuses it with the reason.

    ``lens`` comes from `skymosaic.imagery.lens.load_lens`, ``control_points`` from
    `skymosaic.maps.control_points.load_control_points`, ``positions`` from `skymosaic.maps.positions.load_positions`,
    ``onto`` from `skymosaic.maps.base_map.load_base_map`, ``boundary`` from `skymosaic.maps.boundary.load_boundary`.
    The reference photograph of ``scale`` is the right one of two; of more it is the most connected one, without its
    tilt. With a ``scheduler``, two photographs are registered here and blended there. ``repeat`` is a mosaic whose
    transformations, links and lens are taken over for other photographs from the same places, in the same order:
    another band, or another day. ``matches`` are your own as of `skymosaic.register`, by pairs such as
    ``{(0, 1): (left, right)}``; other pairs are matched as always.
    """

    blending: Blending | None = option(
        None,
        "How photographs are blended; by default distance for two, multiband along seams for more.",
        PICTURE,
        label="Blending",
    )
    warp: Warp = option(
        "auto", "auto bends photographs to follow relief, the left one of two, if held-out matches gain by it.", PICTURE
    )
    all_groups: bool = option(
        False,
        "A mosaic of each group of photographs that overlap, numbered.",
        PICTURE,
        not_for_two="two photographs make one mosaic",
    )
    gsd_m: float | None = option(
        None, "Metres on the ground per canvas pixel, instead of `scale`; needs GPS.", MAP, above=0
    )
    memory_bytes: int = option(
        MEMORY_BYTES,
        "Limit of the decoded photographs kept at once.",
        MACHINE,
        unit=MEGABYTE,
        unit_name="megabytes",
        minimum=64 * MEGABYTE,
    )
    repeat: Mosaic | None = None

    def check_for(self, photographs: int) -> None:
        """`check`, and refuse what has no effect on this number of photographs, before the long work begins.

        Raises
        ------
        InputError
            As in `check`, and for an option that would have no effect.
        """
        if photographs < 2:
            raise InputError(f"a mosaic takes at least two photographs, not {photographs}")
        self.check()
        if self.gsd_m is not None and self.scale != 1:
            raise InputError("`gsd_m` and `scale` both set the size of the mosaic; leave one out")
        if self.onto is not None and self.scale != 1:
            raise InputError("`onto` and `scale` both set the size of the mosaic; leave one out, or give `gsd_m`")
        for name in ("positions", "onto"):
            if self.repeat is not None and getattr(self, name) is not None:
                raise InputError(f"`{name}` and `repeat` both place the photographs; leave one out")
        method, _ = self.choose_method()
        if photographs > 2 and not method.on_accelerator:
            raise InputError(
                f"{method.detector} with {method.descriptor}: more than two photographs take Harris or FAST with ILBP, "
                "by which overlaps are found; choose these, or keep only two photographs"
            )
        if photographs == 2:
            # Only two photographs have passes; `choose_effort` refuses those that the method does not allow.
            self.choose_effort(method)
        if self.repeat is not None and self.warp != "auto":
            raise InputError("`repeat` takes over what bends photographs, so `warp` would have no effect; leave it out")
        if self.repeat is not None and self.matches is not None:
            raise InputError("`repeat` takes over links, so `matches` would have no effect; leave one out")
        self.read_matches(photographs)
        for each in options_of(type(self)):
            value, reason = getattr(self, each.name), each.not_for_two if photographs == 2 else each.not_for_more
            if reason and value != each.default:
                chosen = f"`{each.name}` {value}" if isinstance(value, str) else f"`{each.name}`"
                advice = "" if photographs == 2 else ", or keep only two photographs"
                raise InputError(f"{chosen}: {reason}; leave it out{advice}")

    def flight_settings(self) -> Settings:
        """As `SurveyOptions.flight_settings`, for the method."""
        _, config = self.choose_method()
        return replace(super().flight_settings(), config=config)
