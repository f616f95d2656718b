"""A mosaic made during the flight: every frame is registered when it arrives, and at the end all are composed.

In memory, only the features and a thumbnail of past frames are kept, as of a flight's photographs. A new frame is
registered against several frames that it overlaps, not only against the last one, so that parallel legs of a flight
constrain each other. From time to time the layout of all frames is recomputed. A frame that matches nothing
begins a separate part, which is joined with another one when a later frame overlaps both.

With the estimator ``fabric``, frames are laid out by the homographies that the chip sends, each from the frame before
(`skymosaic.mosaicking.live.record_chain`); features and matches play no part.
"""

import contextlib
import math
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, NoReturn, Self, Unpack

import numpy as np

from golden_model.arrays import Array, Pixels, Records
from skymosaic.common.errors import InputError, RegistrationError
from skymosaic.common.options import choose_options, list_options
from skymosaic.common.replaced import refuse_inputs
from skymosaic.compositing.warp import CanvasError
from skymosaic.features.contrast import find_pattern
from skymosaic.flight.linking.links import Candidate, Link
from skymosaic.flight.linking.view import View, describe_thumbnail, make_view
from skymosaic.flight.mapping.cameras import Camera
from skymosaic.flight.mapping.place import MapPlace, place_cameras
from skymosaic.flight.picture.output import Delivery
from skymosaic.geometry.estimators import FABRIC
from skymosaic.geometry.homography import apply
from skymosaic.imagery.exif import Metadata
from skymosaic.imagery.images import Photograph, check_given, load, reduce_for_front_end
from skymosaic.imagery.patterns import is_folder, only_match
from skymosaic.imagery.photographs import Images, Source, forget_decoded, list_sources
from skymosaic.mosaicking.live.growing_flight import GrowingFlight, Placement, link_by_features
from skymosaic.mosaicking.live.kept_frames import FullError, KeptFrames
from skymosaic.mosaicking.live.preview import paint_preview
from skymosaic.mosaicking.live.record_chain import RecordChain
from skymosaic.mosaicking.live.update import LiveUpdate
from skymosaic.mosaicking.options import LiveOptions, MosaicOptions
from skymosaic.mosaicking.run import MosaicRun, tell_notes
from skymosaic.registration.extraction import extract_within_capacity
from skymosaic.running.workers import Progress, Workers, silent

if TYPE_CHECKING:
    from skymosaic.keywords import LiveKeywords


MIN_FEATURES = 50
"""A frame with fewer features begins no part."""


class LiveMosaic:
    """Registers frames as they arrive, and composes them when it is saved.

    The mosaic is the part with the most frames. Its reference frame is that of its first frame without the tilt. As a
    context manager it calls `finish` at the end. Frames without a file are kept losslessly in a temporary folder, at
    most 32 GB of them, for as long as this object lives.

    Parameters
    ----------
    options : LiveOptions, optional
        ``band`` is for whoever chooses the frames: all that `add` gets are taken.
    on_frame : callable, optional
        Receives the `LiveUpdate` of each frame. What it raises leaves `add`; the frame stays in the mosaic.
    **changes
        Single options by the names of `LiveOptions`; they take precedence over ``options``.

    Attributes
    ----------
    left_out_moving : bool
        Whether frames showed what moves with the camera, such as a display, which was not counted.

    Raises
    ------
    InputError
        For an unknown name, an impossible value or an impossible combination of options.

    Examples
    --------
    >>> from sim.scene import make_lawnmower
    >>> with LiveMosaic(on_frame=lambda update: print(update.number, update.reason or "placed")) as live:
    ...     for image in make_lawnmower(1, 3, (320, 240)).images:
    ...         _ = live.add(image)
    0 placed
    1 placed
    2 placed
    >>> sorted(live.transforms)
    [0, 1, 2]
    """

    @list_options
    def __init__(
        self,
        options: LiveOptions | None = None,
        *,
        on_frame: Callable[[LiveUpdate], object] = lambda _update: None,
        **changes: "Unpack[LiveKeywords]",
    ) -> None:
        self._options = options = choose_options(LiveOptions, options, changes)
        options.check()
        self._run_options = MosaicOptions(**vars(options))
        self._settings = self._run_options.flight_settings()
        self._config = options.base_config
        self._front_end = options.open_backend()
        by_chip = options.estimator == FABRIC
        self._chain = RecordChain(self._front_end, self._config, options.seed) if by_chip else None
        self.left_out_moving = False
        self._kept = KeptFrames(keep_damaged=options.keeps_damaged)
        self._flight = GrowingFlight(self._link)
        self._sources: dict[int, Source] = {}
        self._frames: list[tuple[str, str]] = []
        """Name of each frame, and why it was left out."""
        self._files: list[Path] = []
        self._on_frame = on_frame
        self._started_s, self._stamp = time.monotonic(), -math.inf

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, value: BaseException | None, _: TracebackType | None) -> None:
        """What has been placed is laid out after an error, too."""
        self.finish()

    def __reduce__(self) -> NoReturn:
        """Refuse to be pickled."""
        raise TypeError("a LiveMosaic holds a front end and frames on disk, so it is not pickled; its updates are")

    @property
    def preview(self) -> Pixels:
        """The mosaic so far, reduced, (H, W, 3) uint8 BGR; 0 where there is no frame; empty before the first one."""
        return paint_preview([(self._flight.views[number], place) for number, place in self._flight.largest.items()])

    @property
    def transforms(self) -> dict[int, Array]:
        """For each frame's number, the transformation (3, 3) from its original pixels to the reference frame."""
        return {number: self._from_original(number, place) for number, place in self._flight.largest.items()}

    @property
    def left_out(self) -> dict[int, str]:
        """Numbers of the frames that are not in the mosaic, with the reasons."""
        inside = self._flight.largest
        why = "in another part of {} frames, which nothing joins to this one"
        parts = [part for part in self._flight.parts.values() if len(part) > 1]
        apart = {number: why.format(len(part)) for part in parts for number in part}
        outside = [(number, *frame) for number, frame in enumerate(self._frames) if number not in inside]
        default = "does not overlap the mosaic"
        return {number: f"{name}: {reason or apart.get(number, default)}" for number, name, reason in outside}

    @property
    def place(self) -> MapPlace:
        """Where the reference frame lies on the map, by the GPS positions of its frames; or why that is not known."""
        views = [(self._flight.views[number], place) for number, place in self._flight.largest.items()]
        return place_cameras([Camera(view.name, view.working_size, place, view.taken) for view, place in views])

    def add(
        self,
        image: str | Path | Pixels | Photograph,
        features: Records | None = None,
        *,
        name: str = "",
        taken: Metadata | None = None,
        file: Path | None = None,
        stamp: float | None = None,
    ) -> LiveUpdate:
        """Register the next frame: a tenth of a second for 640x480, as long as for some older frames.

        Whenever a part has twice as many frames, this call lays all of them out again: some milliseconds for each.

        Parameters
        ----------
        image : path, or ndarray of uint8, shape (H, W) or (H, W, 3) BGR
        features : structured ndarray, optional
            Its features, if a front end has already computed them (such as a camera's, in sequence mode), from the
            frame reduced to the working width.
        name : str
            By default that of the file, or "frame N".
        taken : Metadata, optional
            What the camera recorded, above all its position; by default what the file says.
        file : Path, optional
            Where these pixels can be read again when the mosaic is composed; else they are kept.
        stamp : float, optional
            When it was taken, s from any beginning; never before the frame before it.

        Returns
        -------
        LiveUpdate
            With the reason, for a frame that cannot be used.

        Raises
        ------
        InputError
            For what can be no frame: another type, another dtype or shape, a folder; for a stamp that runs backwards.
        FullError
            If there is no room for the frame. Those placed so far can be saved.
        """
        if not isinstance(image, Photograph):
            check_given(image, "frame")
        if stamp is not None and not self._stamp <= stamp < math.inf:
            raise InputError(f"`stamp` {stamp:g}: a finite number, at least that of the frame before, {self._stamp:g}")
        self._stamp = self._stamp if stamp is None else stamp
        number, path = len(self._frames), file
        if isinstance(image, str | Path):
            path = only_match(Path(image))
            if is_folder(path):
                raise InputError(f"{path}: a folder is no frame; extend() adds its pictures")
        name = name or (image.name if isinstance(image, Photograph) else "") or str(path or f"frame {number}")
        self._files += [path] if path else []
        view, placement, transform, reason = None, None, None, ""
        part, before = None, set(self._flight.parts)
        try:
            if not isinstance(image, Photograph):
                image = load(path or image, "frame", keep_damaged=self._options.keeps_damaged)
            view = self._describe(number, replace(image, name=name), features, path, taken)
            placement = self._place(number, view)
            part = self._flight.part_of(number)
            transform = self._from_original(number, self._flight.parts[part][number])
        except FullError:
            raise
        except (CanvasError, InputError) as error:
            reason = str(error)
        self._frames.append((name, reason))
        seconds = time.monotonic() - self._started_s
        update = LiveUpdate(
            number,
            name,
            seconds,
            transform,
            placement,
            reason,
            len(self._flight.parts),
            size_px=(0, 0) if view is None else view.working_size,
            features=None if view is None else view.features,
            part=part,
            joined=tuple(sorted(before - self._flight.parts.keys())),
            stamp=stamp,
        )
        self._on_frame(update)
        return update

    def extend(self, images: Images) -> list[LiveUpdate]:
        """Register several frames in turn; a folder stands for its pictures, a pattern for what it matches."""
        return [self.add(source.content) for source in list_sources(images, recursive=self._options.recursive)]

    def save(self, path: str | Path, *, overwrite: bool = False) -> Delivery:
        """Compose the frames as `skymosaic.mosaic` composes photographs, and write the mosaic.

        A ``.tif`` of frames with GPS lies on the map.

        Raises
        ------
        InputError
            For a file that cannot be written, is one of the frames, or exists and must not be overwritten.
        RegistrationError
            Without a frame.
        """
        refuse_inputs(Path(path), self._files)
        with self.open_run() as run:
            return run.write(Path(path), overwrite=overwrite)[0]

    @contextlib.contextmanager
    def open_run(
        self, tell: Callable[[str], None] = lambda _line: None, progress: Progress = silent
    ) -> Iterator[MosaicRun]:
        """A run whose flight is that of the frames, for as long as the context lasts; raises as `save`."""
        if not self.transforms:
            raise RegistrationError("no frame could be used")
        names = tuple(name for name, _ in self._frames)
        left_out = {number: f"{name}: {reason}" for number, (name, reason) in enumerate(self._frames) if reason}
        progress("laying out", 0, 0)
        # The chip links each frame with the one before it alone.
        chosen = self._flight if self._chain else self._flight.thinned()
        flight = chosen.finished(self._sources, names, left_out, self._settings)
        tell_notes(flight, tell)
        with Workers(progress=progress, memory_bytes=self._run_options.memory_bytes) as workers:
            try:
                yield MosaicRun(flight.sources, self._run_options, workers, tell, flight)
            finally:
                forget_decoded()

    def finish(self) -> None:
        """Recompute the layout after the last frame."""
        for part in tuple(self._flight.parts):
            self._flight.lay_out(part)

    def _link(self, pair: Candidate, left: View, right: View) -> Link:
        if self._chain:
            return self._chain.link(pair)
        link = link_by_features(pair, left, right, config=self._config, seed=self._options.seed)
        self.left_out_moving |= link.moves_with_camera
        if link.moves_with_camera and not link.holds and left.thumbnail.shape == right.thumbnail.shape:
            return self._link_without_pattern(pair, left, right)
        return link

    def _link_without_pattern(self, pair: Candidate, left: View, right: View) -> Link:
        """Link two frames by their thumbnails, without what both show at the same pixels."""
        pattern = find_pattern((left.thumbnail, right.thumbnail))
        views = [describe_thumbnail(view.thumbnail, view, self._settings, True, pattern) for view in (left, right)]
        link = link_by_features(pair, *views, config=self._config, seed=self._options.seed)
        moves = {
            number: partial(apply, view.sight.to_working) for number, view in zip(pair, (left, right), strict=True)
        }
        return link.move(moves)

    def _describe(
        self, number: int, photograph: Photograph, features: Records | None, file: Path | None, taken: Metadata | None
    ) -> View:
        """Reduce a frame to the working width, compute its features unless they are given, and keep it."""
        working, to_original = reduce_for_front_end(photograph.pixels, self._options.working_width_px, "frame")
        if features is None and self._chain:
            features = self._chain.describe(number, working)
        elif features is None:
            results, _ = extract_within_capacity(self._front_end, [working], self._config)
            features = results[0].features
        source = self._sources[number] = self._kept.keep(number, photograph.name, photograph.pixels, file)
        # What is kept of a frame without a file says nothing of its camera.
        taken = taken or (None if file else Metadata())
        return make_view(
            source, photograph, self._settings, working=working, to_original=to_original, features=features, taken=taken
        )

    def _place(self, number: int, view: View) -> Placement | None:
        """Add a frame to a part that it overlaps, or begin one with it."""
        placement = self._flight.add(number, view)
        if placement is None:
            if len(view.features) < MIN_FEATURES:
                raise InputError(f"too few features (flat or blurred?): {len(view.features)}, {MIN_FEATURES} needed")
            self._flight.begin(number, view)
        self._flight.settle()
        return placement

    def _from_original(self, number: int, place: Array) -> Array:
        """Original pixels of a frame to the reference frame of its part, (3, 3)."""
        return np.asarray(place @ np.linalg.inv(self._flight.views[number].to_original), dtype=np.float64)
