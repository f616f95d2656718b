"""Repeats the layout of a flight with other photographs from the same places: another band, or another day."""

from collections.abc import Sequence
from dataclasses import replace

from golden_model.cache import Cache
from skymosaic.common.errors import InputError
from skymosaic.flight.flight import Flight
from skymosaic.flight.linking.surveyor import Surveyor
from skymosaic.imagery.photographs import Source
from skymosaic.running.workers import Workers


def repeat_flight(known: Flight, sources: Sequence[Source], seed: int, workers: Workers, cache: Cache) -> Flight:
    """A flight of other photographs with the links, the lens and the layouts of a known one.

    They are in the order of the known flight's photographs, and of the same sizes.

    Raises
    ------
    InputError
        For another number of photographs, another size, or a photograph that cannot be used.
    """
    if len(sources) != len(known.names):
        raise InputError(
            f"`repeat`: a mosaic of {len(known.names)} photographs, not of {len(sources)}; give the same number"
        )
    used = tuple(sources[source.index] for source in known.sources)
    settings = replace(known.settings, lens=known.lens)
    surveyor = Surveyor(settings, seed, workers, cache)
    views = []
    for view, before in zip(surveyor.fetch_thumbnails(surveyor.describe_all(used)), known.views, strict=True):
        if view.size != before.size:
            sizes = " and ".join(f"{each.name} {each.size[0]}x{each.size[1]}" for each in (before, view))
            raise InputError(f"`repeat`: photographs of different sizes ({sizes}); give those of the same camera")
        # The place on the map is repeated too, so that the mosaics lie on each other pixel by pixel.
        views.append(replace(view, taken=replace(before.taken, black_level=view.taken.black_level)))
    pair = known.pair
    if pair is not None:
        left, right = (source.read_photograph(known.lens) for source in used)
        pair = replace(pair, left=left, right=right, seconds={})
    return replace(
        known,
        names=tuple(source.name for source in sources),
        sources=used,
        views=tuple(views),
        left_out={index: f"{sources[index].name}: left out of the known layout" for index in known.left_out},
        seconds={},
        pair=pair,
    )
