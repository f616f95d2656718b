"""What is refused before the work begins: an output that cannot be written, or cannot be what is required of it."""

import contextlib
import os
import re
from collections.abc import Sequence
from pathlib import Path

from golden_model.config import MIN_FRAME_PX
from skymosaic.common.errors import InputError
from skymosaic.flight.mapping.place import MAX_AWAY_M, MapPlace, require_place
from skymosaic.flight.picture.canvas import check_scale
from skymosaic.flight.picture.composition import Room
from skymosaic.flight.picture.formats import OutputForm, format_of, room_for, sources_of, too_deep_for_jpeg
from skymosaic.imagery.decoding import read_header
from skymosaic.imagery.exif import explain_missing_gps
from skymosaic.imagery.images import check_output, check_output_folder
from skymosaic.imagery.photographs import Source
from skymosaic.maps.boundary import Boundary
from skymosaic.maps.tiles import OWN_NAMES
from skymosaic.mosaicking.options import MEGAPIXEL, MosaicOptions, SurveyOptions

MIN_ROOM_PX, MIN_COMPUTED_PX = 1_000_000, 100_000
"""A disk with less room is refused before the first feature, and afterwards; one with more gets a reduced mosaic."""


def check_outputs(
    output: Path,
    form: OutputForm,
    sources: Sequence[Source],
    options: MosaicOptions,
    *,
    overwrite: bool = False,
    computed: bool = False,
) -> None:
    """Check that the mosaics of ``sources`` can be written, before anything is ``computed``, or afterwards.

    Raises
    ------
    InputError
        For an output that cannot be written, would replace a photograph, or exists and must not be overwritten;
        for a form that does not suit it; as `check_boundary`.
    RegistrationError
        For a map that is required where nothing can give the mosaic a place.
    """
    form.check(output, len(sources[0].bands))
    inputs = [file for source in sources for file in source.files]
    inputs += [Path(options.onto.name)] if options.onto is not None else []
    if form.tiles is not None:
        check_output_folder(form.tiles, inputs, OWN_NAMES, overwrite=overwrite)
    written = [output, *(list_numbered(output) if options.all_groups else ())]
    for path in (*written, *(map(sources_of, written) if form.sources else ())):
        check_output(path, inputs, overwrite=overwrite)
    if options.canvas_limit_px is None and not computed:
        check_room(output, room_of(output, sources, options))
    if options.repeat is None:
        if form.needs_place(output) and (note := _explain_no_place(sources, options)):
            require_place(output, MapPlace(note=note))
        if options.boundary is not None:
            check_boundary(sources, options, options.boundary)
    if options.all_groups and form.tiles is not None:
        for path in list_numbered(form.tiles):
            check_output_folder(path, inputs, OWN_NAMES, overwrite=overwrite)
    # Last, because it may read all files.
    _check_headers(output, form, sources, options.scale)


def check_room(output: Path, room: Room, least_px: float = MIN_ROOM_PX) -> None:
    """Raise InputError for a disk that is too full to begin, or has become so."""
    if room.area_px < least_px:
        raise InputError(f"{output}: {room.reason}, too little for a mosaic; free some, or choose another folder")


def room_of(path: Path | None, sources: Sequence[Source], options: MosaicOptions) -> Room:
    """How large a mosaic in this file may become; None: in memory. Raises InputError for a disk that is full."""
    if options.canvas_limit_px is not None:
        limit_px = options.canvas_limit_px
        side_px = Room.side_px if path is None else format_of(path).max_side_px
        sides = f", with sides of at most {side_px:,} px" if side_px < Room.side_px else ""
        return Room(limit_px, side_px, f"the limit is {limit_px / MEGAPIXEL:g} megapixels{sides}")
    if path is None or len(sources) == 2:
        return Room()
    room = room_for(path, 1 + max(3, len(sources[0].bands)))
    check_room(path, room, MIN_COMPUTED_PX)
    return room


def _check_headers(output: Path, form: OutputForm, sources: Sequence[Source], scale: float) -> None:
    """Refuse what the sizes and depths that the photographs declare already forbid."""
    if form.compress != "jpeg" and scale * MIN_FRAME_PX >= 1:
        return
    headers = []
    for source in sources:
        # What cannot be read is said when it is read.
        with contextlib.suppress(InputError):
            headers += [read_header(source.content)] if isinstance(source.content, Path) else []
    if len(headers) < len(sources):
        return
    check_scale(scale, [header.size for header in headers])
    if form.compress == "jpeg" and all(header.sample_bytes == 2 for header in headers):
        raise too_deep_for_jpeg(output)


def check_boundary(sources: Sequence[Source], options: SurveyOptions, boundary: Boundary) -> None:
    """Raise InputError for a boundary where nothing can place the mosaic on the map, or far from the photographs."""
    if note := _explain_no_place(sources, options, boundary):
        raise InputError(f"{boundary.name}: the map cannot end there: {note}")


def _explain_no_place(sources: Sequence[Source], options: SurveyOptions, boundary: Boundary | None = None) -> str:
    """Why nothing could place the mosaic on the map, and near a boundary; empty if something may."""
    if options.control_points is not None or options.positions is not None:
        return ""
    taken, away_m = [], list[float]()
    for source in sources:
        # What cannot be read is said when it is read.
        if isinstance(source.content, Path) and not os.access(source.content, os.R_OK):
            return ""
        taken.append(source.read_metadata())
        if (position := taken[-1].position) is not None:
            away_m.append(0.0 if boundary is None else boundary.metres_to(position))
            if away_m[-1] < MAX_AWAY_M:
                return ""
    far = f"the photographs' GPS is {min(away_m, default=0.0) / 1000:.0f} km away; check the coordinate system"
    return far if away_m else explain_missing_gps(taken)


def list_numbered(base: Path) -> list[Path]:
    """List what exists under the names that the outputs of further groups get: how many there are is not known yet."""
    if base.name in ("", ".."):
        raise InputError(f"{base}: has no name that could be numbered for several groups; name another folder")
    numbered = re.compile(re.escape(base.stem) + r"_\d+" + re.escape(base.suffix))
    return [path for path in sorted(base.parent.glob("*")) if numbered.fullmatch(path.name)]
