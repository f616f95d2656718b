"""The options of a mosaic, and which of them apply to two photographs and which to more."""

from dataclasses import dataclass
from pathlib import Path

from skymosaic.common.errors import InputError
from skymosaic.common.options import INPUT, MACHINE, MAP, PICTURE, document_options, option, options_of
from skymosaic.compositing.blend import METHODS
from skymosaic.flight.linking.view import Settings
from skymosaic.flight.picture.composition import MEMORY_BYTES
from skymosaic.imagery.lens import Lens
from skymosaic.maps.control_points import ControlPoints
from skymosaic.maps.positions import Positions
from skymosaic.mosaicking.result import Mosaic
from skymosaic.registration.options import RegistrationKeywords, RegistrationOptions

MEGABYTE = 1 << 20
MEGAPIXEL = 1_000_000


@document_options
@dataclass(frozen=True, kw_only=True)
class MosaicOptions(RegistrationOptions):
    """How photographs become a mosaic. Each option applies, or `check_for` refuses it with the reason.

    ``lens`` comes from `skymosaic.imagery.lens.load_lens`, ``control`` from
    `skymosaic.maps.control_points.load_control_points`, ``positions`` from `skymosaic.maps.positions.load_positions`.
    The reference photograph of ``scale`` is the right one of two; of more it is the most connected one, without its
    tilt. With a ``scheduler``, two photographs are registered here and blended there. ``layout`` is a mosaic whose
    transformations, links and lens are taken over for other photographs from the same places, in the same order:
    another band, or another day.
    """

    lens: Lens | None = option(
        None, "Distortion and mask, the same for all photographs.", INPUT, flag="--camera or --mask"
    )
    band: str | None = option(
        None, "Band of multi-band sets that registers the flight, by name or number: nir, 2.", INPUT
    )
    blending: str | None = option(
        None,
        "How photographs are blended; by default distance for two, multiband along seams for more.",
        PICTURE,
        choices=tuple(METHODS),
        flag="--blend",
    )
    scale: float = option(1.0, "Canvas pixels per pixel of the reference photograph.", PICTURE, above=0, maximum=1)
    warp: str = option(
        "homography",
        "A mesh warps the left photograph over relief; auto: only if held-out matches gain by it.",
        PICTURE,
        choices=("homography", "mesh", "auto"),
        not_for_more="more than two photographs are laid out by homographies",
    )
    canvas_limit_px: int | None = option(
        None,
        "Maximum canvas size; by default what the file can hold, or 250 megapixels of a live mosaic.",
        PICTURE,
        flag_unit=MEGAPIXEL,
        flag_unit_name="megapixels",
        minimum=1,
    )
    all_groups: bool = option(
        False,
        "A mosaic of each group of photographs that overlap, numbered.",
        PICTURE,
        not_for_two="two photographs make one mosaic",
    )
    gsd_m: float | None = option(
        None, "Metres on the ground per canvas pixel, instead of --scale; needs GPS.", MAP, above=0
    )
    control: ControlPoints | None = option(
        None, "Ground control points instead of GPS, from OpenDroneMap's gcp_list.txt.", MAP, flag="--gcp"
    )
    positions: Positions | None = option(
        None,
        "Positions of the cameras instead of GPS, from OpenDroneMap's geo.txt.",
        MAP,
        flag="--geo",
        not_for_two="two photographs stay in the frame of the right one",
    )
    memory_bytes: int = option(
        MEMORY_BYTES,
        "Limit of the decoded photographs kept at once.",
        MACHINE,
        flag_unit=MEGABYTE,
        flag_unit_name="megabytes",
        minimum=64 * MEGABYTE,
    )
    scheduler: str | None = option(None, "Dask scheduler, tcp://HOST:PORT or a scheduler file.", MACHINE)
    cache: Path | None = option(
        None,
        "Folder that keeps features and links of flights for the next run; by default in the user's cache, up to 2 GB.",
        MACHINE,
        not_for_two="two photographs are registered anew each time",
    )
    layout: Mosaic | None = None

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
            raise InputError("gsd and scale both set the size of the mosaic; leave one out")
        if self.layout is not None and self.positions is not None:
            raise InputError("positions and layout both place the photographs; leave one out")
        method, _ = self.choose_method()
        if photographs > 2 and not method.on_accelerator:
            raise InputError(
                f"{method.detector} with {method.descriptor}: more than two photographs take Harris or FAST with ILBP, "
                "by which overlaps are found; choose these, or keep only two photographs"
            )
        if photographs == 2:
            # Only two photographs have passes; `choose_effort` refuses those that the method does not allow.
            self.choose_effort(method)
            if self.lens is not None and self.lens.mask is not None and self.warp != "homography":
                raise InputError("warp: a mask would not be bent with the photograph; leave one out")
        for each in options_of(type(self)):
            value, reason = getattr(self, each.name), each.not_for_two if photographs == 2 else each.not_for_more
            if reason and value != each.default:
                chosen = f"{each.name} {value}" if isinstance(value, str) else each.name
                advice = "" if photographs == 2 else ", or keep only two photographs"
                raise InputError(f"{chosen}: {reason}; leave out {each.flag}{advice}")

    def flight_settings(self) -> Settings:
        """How the features of a flight's photographs are computed."""
        _, config = self.choose_method()
        return Settings(config, self.backend_name, self.working_width_px, self.lens or Lens())


class MosaicKeywords(RegistrationKeywords, total=False):
    """The fields of `MosaicOptions` as keyword arguments, which type checkers and editors know."""

    lens: Lens | None
    band: str | None
    blending: str | None
    scale: float
    warp: str
    canvas_limit_px: int | None
    all_groups: bool
    gsd_m: float | None
    control: ControlPoints | None
    positions: Positions | None
    memory_bytes: int
    scheduler: str | None
    cache: Path | None
    layout: Mosaic | None
