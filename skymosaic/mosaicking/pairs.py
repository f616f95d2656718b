"""Registers many pairs of some photographs, each of which is read and described once."""

import dataclasses
import itertools
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Unpack

from golden_model.arrays import Pixels
from skymosaic.common.errors import InputError
from skymosaic.common.options import choose_options, list_options
from skymosaic.common.tables import Table, tabulate
from skymosaic.imagery.photographs import Images, Source, list_sources
from skymosaic.registration.extraction import Features, extract
from skymosaic.registration.options import RegistrationOptions
from skymosaic.registration.pair import Pair
from skymosaic.registration.register import register
from skymosaic.running.workers import Progress, Workers, silent

if TYPE_CHECKING:
    from skymosaic.keywords import RegistrationKeywords


@list_options
def register_pairs(
    images: Images,
    pairs: Iterable[tuple[int, int]] | None = None,
    options: RegistrationOptions | None = None,
    *,
    progress: Progress = silent,
    **changes: "Unpack[RegistrationKeywords]",
) -> list[Pair]:
    """Register many pairs on all cores, as `register` does each.

    Parameters
    ----------
    images : path or array, or several
        As in `mosaic`, without videos.
    pairs : iterable of (int, int), optional
        Left and right photograph of each pair, by their indices; by default every two photographs.
    options, **changes
        As in `register`.
    progress : callable
        As in `mosaic`.

    Returns
    -------
    list of Pair
        Without pixels, see `Pair.without_pixels`; `table_of_pairs` has their numbers.

    Raises
    ------
    InputError
        For a photograph that cannot be used, a pair of others than these, or as in `register`.

    Examples
    --------
    >>> from sim.scene import make_lawnmower
    >>> pairs = register_pairs(make_lawnmower(1, 3, (320, 240)).images)
    >>> table = table_of_pairs(pairs)
    >>> table["left"].tolist(), table["right"].tolist()
    (['image 0', 'image 0', 'image 1'], ['image 1', 'image 2', 'image 2'])
    """
    options = choose_options(RegistrationOptions, options, changes)
    sources = list_sources(images)
    numbers = range(len(sources))
    every_two = itertools.combinations(numbers, 2)
    try:
        sides_of = [(numbers[left], numbers[right]) for left, right in (every_two if pairs is None else pairs)]
    except (TypeError, ValueError, IndexError):
        raise InputError(f"pairs: give the numbers of two photographs for each, 0 to {len(sources) - 1}") from None
    with Workers(progress=progress) as workers:
        sides = list(workers.run("features", _describe, [(source, options) for source in sources]))
        wanted = [(sides[left], sides[right]) for left, right in sides_of]
        return list(workers.run("pairs", lambda left, right: register(left, right, options).without_pixels(), wanted))


def _describe(source: Source, options: RegistrationOptions) -> Path | Pixels | Features:
    """The features of a photograph, without its pixels; itself where pairs do not share features."""
    if not options.choose_method()[0].on_accelerator:
        return source.content
    features = extract(source.content, options)
    photograph = dataclasses.replace(features.photograph, name=source.name).without_pixels()
    return dataclasses.replace(features, photograph=photograph)


def table_of_pairs(pairs: Sequence[Pair]) -> Table:
    """A row for each pair: names, verdict, counts, and the homography as ``h11`` to ``h33``, NaN where not accepted."""
    return tabulate(pair.row() for pair in pairs)
