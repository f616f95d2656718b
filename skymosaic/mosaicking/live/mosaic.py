"""A mosaic made during the flight: every frame is registered when it arrives, and at the end all are composed.

In memory, only the features and a thumbnail of past frames are kept. A new frame is registered against several frames
that it overlaps, not only against the last one, so that parallel legs of a flight constrain each other. From time to
time the layout of all frames is recomputed. A frame that matches nothing starts a separate submap, which is merged with
another one when a later frame overlaps both.

With the estimator ``fabric``, frames are laid out by the homographies that the chip sends, each from the frame before
(`skymosaic.mosaicking.live.record_chain`); features and matches play no part.
"""

import contextlib
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from golden_model.arrays import Array, Pixels, Records
from skymosaic.common.errors import InputError, RegistrationError
from skymosaic.common.options import choose_options, list_options
from skymosaic.common.replaced import refuse_inputs
from skymosaic.compositing.warp import Canvas, CanvasError
from skymosaic.features.contrast import even_contrast, find_pattern
from skymosaic.flight.linking.links import Link, link_views
from skymosaic.flight.linking.view import THUMBNAIL_WIDTH_PX
from skymosaic.flight.mapping.cameras import Camera
from skymosaic.flight.mapping.place import MapPlace, place_cameras
from skymosaic.flight.picture.output import Delivery
from skymosaic.geometry.estimators import FABRIC
from skymosaic.geometry.ground import Sight
from skymosaic.geometry.homography import apply, estimate_similarity
from skymosaic.imagery.exif import Metadata, read_metadata
from skymosaic.imagery.images import check_given, load, reduce_for_front_end, reduce_to_width
from skymosaic.imagery.patterns import is_folder, only_match
from skymosaic.imagery.photographs import Images, forget_decoded, list_sources
from skymosaic.mosaicking.live.composing import flight_of_frames
from skymosaic.mosaicking.live.kept_frames import FullError, KeptFrames
from skymosaic.mosaicking.live.preview import paint_preview
from skymosaic.mosaicking.live.record_chain import RecordChain
from skymosaic.mosaicking.live.submap import Frame, Placement, Submap, likely_neighbours, link_by_features
from skymosaic.mosaicking.live.update import LiveUpdate
from skymosaic.mosaicking.options import LiveOptions, MosaicOptions
from skymosaic.mosaicking.plan import MosaicPlan, tell_pages
from skymosaic.registration.extraction import extract_within_capacity
from skymosaic.running.workers import Workers

MIN_FEATURES = 50
"""A frame with fewer features does not start a submap."""


class LiveMosaic:
    """Registers frames as they arrive, and composes them when it is saved.

    The mosaic is the submap with the most frames. Its reference frame is that of its first frame without the tilt. As a
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
        **changes: Any,
    ) -> None:
        self._options = options = choose_options(LiveOptions, options, changes)
        options.check()
        self._config = options.base_config
        self._front_end = options.open_backend()
        by_chip = options.estimator == FABRIC
        self._chain = RecordChain(self._front_end, self._config, options.seed) if by_chip else None
        self.left_out_moving = False
        self._kept = KeptFrames(keep_damaged=options.keeps_damaged)
        self._submaps: list[Submap] = []
        self._frames: list[tuple[str, str]] = []
        """Name of each frame, and why it was left out."""
        self._files: list[Path] = []
        self._on_frame = on_frame
        self._started_s = time.monotonic()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, value: BaseException | None, _: TracebackType | None) -> None:
        """What has been placed is laid out after an error, too."""
        self.finish()

    @property
    def preview(self) -> Pixels:
        """The mosaic so far, reduced, (H, W, 3) uint8 BGR; 0 where there is no frame; empty before the first one."""
        return paint_preview(tuple(self._mosaic.frames.values()))

    @property
    def transforms(self) -> dict[int, Array]:
        """For each frame's number, the transformation (3, 3) from its original pixels to the reference frame."""
        return {frame.number: frame.from_original for frame in self._mosaic.frames.values()}

    @property
    def left_out(self) -> dict[int, str]:
        """Numbers of the frames that are not in the mosaic, with the reasons."""
        inside = self._mosaic.frames
        parts = [submap.frames for submap in self._submaps if len(submap.frames) > 1]
        why = "in another part of {} frames, which nothing joins to this one"
        apart = {number: why.format(len(part)) for part in parts for number in part}
        outside = [(number, *frame) for number, frame in enumerate(self._frames) if number not in inside]
        default = "does not overlap the mosaic"
        return {number: f"{name}: {reason or apart.get(number, default)}" for number, name, reason in outside}

    @property
    def place(self) -> MapPlace:
        """Where the reference frame lies on the map, by the GPS positions of its frames; or why that is not known."""
        frames = self._mosaic.frames.values()
        return place_cameras([Camera(frame.name, frame.size, frame.transform, frame.taken) for frame in frames])

    def add(
        self,
        image: str | Path | Pixels,
        features: Records | None = None,
        *,
        name: str = "",
        taken: Metadata | None = None,
        file: Path | None = None,
    ) -> LiveUpdate:
        """Register the next frame.

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

        Returns
        -------
        LiveUpdate
            With the reason, for a frame that cannot be used.

        Raises
        ------
        InputError
            For what can be no frame: another type, another dtype or shape, a folder.
        FullError
            If there is no room for the frame. Those placed so far can be saved.
        """
        check_given(image, "frame")
        number, path = len(self._frames), None
        if isinstance(image, str | Path):
            image = path = only_match(Path(image))
            if is_folder(path):
                raise InputError(f"{path}: a folder is no frame; extend() adds its pictures")
        name = name or str(path or f"frame {number}")
        self._files += [each for each in (path, file) if each]
        frame, placement, transform, reason = None, None, None, ""
        try:
            pixels = load(image, "frame", keep_damaged=self._options.keeps_damaged).pixels
            taken = taken or (read_metadata(path) if path else Metadata())
            frame = self._describe(pixels, features, name, taken)
            self._kept.keep(number, name, pixels, file or path)
            submap, placement = self._place(frame)
            transform = submap.frames[number].from_original
        except FullError:
            raise
        except (CanvasError, InputError) as error:
            placement, reason = None, str(error)
        self._frames.append((name, reason))
        facts = () if frame is None else (frame.size, frame.features)
        seconds = time.monotonic() - self._started_s
        update = LiveUpdate(number, name, seconds, transform, placement, reason, len(self._submaps), *facts)
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
        with self.open_plan() as plan:
            return plan.write(Path(path), overwrite=overwrite)[0]

    @contextlib.contextmanager
    def open_plan(self, tell: Callable[[str], None] = lambda _line: None) -> Iterator[MosaicPlan]:
        """A plan whose flight is that of the frames, for as long as the context lasts; raises as `save`."""
        if not self.transforms:
            raise RegistrationError("no frame could be used")
        frames = tuple(self._mosaic.frames.values())
        options = MosaicOptions(**vars(self._options))
        with Workers(memory_bytes=options.memory_bytes) as workers:
            flight = flight_of_frames(frames, self._mosaic.links, self._kept, options.flight_settings(), workers)
            plan = MosaicPlan(flight.sources, options, workers, tell)
            plan.flight = flight
            tell_pages(flight, tell)
            try:
                yield plan
            finally:
                forget_decoded()

    def finish(self) -> None:
        """Recompute the layout after the last frame."""
        self._mosaic.settle(at_last=True)

    @property
    def _mosaic(self) -> Submap:
        """The submap with the most frames; an empty submap before the first frame."""
        return max(self._submaps, key=lambda submap: len(submap.frames), default=Submap(self._link))

    def _link(self, left: Frame, right: Frame) -> Link:
        if self._chain:
            return self._chain.link((left.number, right.number))
        link = link_by_features(left, right, self._config, self._options.seed)
        self.left_out_moving |= link.moves_with_camera
        if link.moves_with_camera and not link.holds and left.thumbnail.shape == right.thumbnail.shape:
            return self._link_without_pattern(left, right)
        return link

    def _link_without_pattern(self, left: Frame, right: Frame) -> Link:
        """Link two frames by their thumbnails, without what both show at the same pixels."""
        pattern = find_pattern((left.thumbnail, right.thumbnail))
        pictures = [even_contrast(frame.thumbnail, pattern) for frame in (left, right)]
        (one, other), config = extract_within_capacity(self._front_end, pictures, self._config)
        sights = Sight(pictures[0]), Sight(pictures[1])
        pair, seed = (left.number, right.number), self._options.seed
        link = link_views(pair, one.features, other.features, config=config, seed=seed, sights=sights)
        return link.move({frame.number: partial(apply, frame.from_thumbnail) for frame in (left, right)})

    def _describe(self, pixels: Pixels, features: Records | None, name: str, taken: Metadata) -> Frame:
        """Reduce a frame to the working width, and compute its features unless they are given."""
        working, to_original = reduce_for_front_end(pixels, self._options.working_width_px, "frame")
        if features is None and self._chain:
            features = self._chain.describe(len(self._frames), working)
        elif features is None:
            results, _ = extract_within_capacity(self._front_end, [working], self._config)
            features = results[0].features
        size = working.shape[1], working.shape[0]
        thumbnail, from_thumbnail = reduce_to_width(working, THUMBNAIL_WIDTH_PX)
        return Frame(
            len(self._frames), size, features, to_original, to_original, name, taken, thumbnail, from_thumbnail
        )

    def _place(self, frame: Frame) -> tuple[Submap, Placement | None]:
        """Add a frame to a submap that it overlaps, or to a new one."""
        placement = None
        if found := self._register(frame, self._submaps):
            submap, placement = found
            placed = frame.moved(placement.transform)
            submap.add(placed)
            # Parts stay apart that would look behind the camera together.
            with contextlib.suppress(CanvasError):
                submap = self._join(submap, placed)
            submap.settle()
        elif len(frame.features) < MIN_FEATURES:
            raise InputError(f"too few features (flat or blurred?): {len(frame.features)}, {MIN_FEATURES} needed")
        else:
            submap = Submap(self._link)
            submap.add(frame)
            self._submaps.append(submap)
        return submap, placement

    def _register(self, frame: Frame, submaps: list[Submap]) -> tuple[Submap, Placement] | None:
        """Find a submap that the frame overlaps, and place the frame in it."""
        home = {number: submap for submap in submaps for number in submap.frames}
        placed = [other for submap in submaps for other in submap.frames.values()]
        for other in likely_neighbours(frame, placed):
            if (placement := home[other.number].register(frame, other)) is not None:
                return home[other.number], placement
        return None

    def _join(self, submap: Submap, frame: Frame) -> Submap:
        """Merge a submap with another one that its newest frame also overlaps; raises CanvasError as `Submap.add`.

        The smaller submap is absorbed by the larger one, which is returned.
        """
        found = self._register(frame, [other for other in self._submaps if other is not submap])
        if not found:
            return submap
        other, placement = found
        corners = Canvas(0, 0, *frame.size).corners
        mapped = {submap: apply(frame.transform, corners), other: apply(placement.transform, corners)}
        # The frame lies in both submaps, so its corners relate them.
        larger, smaller = (other, submap) if len(other.frames) >= len(submap.frames) else (submap, other)
        larger.absorb(smaller, estimate_similarity(mapped[smaller], mapped[larger]))
        self._submaps.remove(smaller)
        return larger
