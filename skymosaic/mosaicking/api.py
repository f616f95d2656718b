"""Makes mosaics: the functions of the Python API, and the run that the command line and the panel use."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Unpack

from skymosaic.common.errors import InputError
from skymosaic.common.options import choose_options, list_options
from skymosaic.imagery.band_sets import group_band_sets
from skymosaic.imagery.key_frames import flight_sources
from skymosaic.imagery.photographs import Images, Source, forget_decoded
from skymosaic.mosaicking.options import MosaicOptions
from skymosaic.mosaicking.result import Mosaic
from skymosaic.mosaicking.run import MosaicRun
from skymosaic.running.workers import Progress, Workers, silent

if TYPE_CHECKING:
    from skymosaic.keywords import MosaicKeywords


@list_options
def mosaic(
    images: Images,
    options: MosaicOptions | None = None,
    *,
    progress: Progress = silent,
    **changes: "Unpack[MosaicKeywords]",
) -> Mosaic:
    """Make a mosaic of overlapping photographs; of several groups, the largest.

    Parameters
    ----------
    images : path or array, or several
        At least two photographs; a folder stands for its pictures, a video for its key frames, and a pattern such as
        ``flight/*.jpg`` for what it matches.
    options : MosaicOptions, optional
    progress : callable
        Receives a stage, how many of its steps are done, and how many there are (0: unknown).
    **changes
        Single options by the names of `MosaicOptions`; they take precedence over ``options``.

    Raises
    ------
    InputError
        For an unusable photograph, or an option that is unusable or has no effect.
    RegistrationError
        If no mosaic can be made, with the reason and the counts.

    Examples
    --------
    >>> from sim.scene import make_pair
    >>> result = mosaic(make_pair(seed=5, size=(320, 240)).images)
    >>> result.placed, result.left_out
    ((0, 1), {})
    >>> result.transforms[1].shape, result.image.dtype
    ((3, 3), dtype('uint8'))
    """
    options = choose_options(MosaicOptions, options, changes)
    # With it, the caller would wait for all groups and get one.
    if options.all_groups:
        raise InputError("`all_groups`: mosaic() makes one mosaic; call mosaics() for one of each group")
    return next(mosaics(images, options, progress=progress))


@list_options
def mosaics(
    images: Images,
    options: MosaicOptions | None = None,
    *,
    progress: Progress = silent,
    **changes: "Unpack[MosaicKeywords]",
) -> Iterator[Mosaic]:
    """Make a mosaic of each group of photographs that overlap, the largest first; arguments as `mosaic`."""
    options = choose_options(MosaicOptions, options, changes)
    with open_run(images, options, progress) as run:
        yield from run.mosaics()


@contextmanager
def open_run(
    images: Images,
    options: MosaicOptions,
    progress: Progress = silent,
    tell: Callable[[str], None] = lambda _line: None,
) -> Iterator[MosaicRun]:
    """A run for ``images``, with its workers and the key frames of videos for as long as the context lasts.

    Parameters
    ----------
    images, options, progress
        As in `mosaic`.
    tell : callable
        Receives a line for each video that is cut off, for what is not used of a folder, or if the cache cannot be
        written.

    Raises
    ------
    InputError
        For a folder without pictures, a single photograph, an unreadable video, unusable options, or an absent
        scheduler.
    """
    progress("reading", 0, 0)
    with flight_sources(images, tell, recursive=options.recursive) as sources:
        captures = group_band_sets(sources, options.band, tell)
        with open_run_of_sources(captures, options, progress, tell) as run:
            yield run


@contextmanager
def open_run_of_sources(
    sources: Sequence[Source],
    options: MosaicOptions,
    progress: Progress = silent,
    tell: Callable[[str], None] = lambda _line: None,
) -> Iterator[MosaicRun]:
    """`open_run` for photographs that are already listed."""
    options.check_for(len(sources))
    sources = [source.with_damaged(keep=options.keeps_damaged) for source in sources]
    try:
        with Workers(
            options.scheduler, progress=progress, sources=sources, memory_bytes=options.memory_bytes
        ) as workers:
            yield MosaicRun(sources, options, workers, tell)
    finally:
        forget_decoded()
