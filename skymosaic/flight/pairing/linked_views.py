"""Links the photographs of a flight: likely pairs, what a layout predicts, and a second look at what stays isolated."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from golden_model.arrays import Array
from skymosaic.flight.layout.linked_group import groups, linked_group
from skymosaic.flight.linking.links import Candidate, Link, valid_links
from skymosaic.flight.linking.surveyor import Surveyor
from skymosaic.flight.linking.view import View
from skymosaic.flight.pairing.candidates import first_candidates, predicted
from skymosaic.flight.pairing.second_look import link_across_heights, link_by_coarse_detail, link_by_more_features
from skymosaic.imagery.photographs import Source

MAX_ROUNDS = 6
"""How often a better layout may propose further pairs."""


@dataclass(frozen=True, eq=False)
class LinkedViews:
    """The photographs of a flight, and the links between them."""

    surveyor: Surveyor
    """Computed the views, and links them."""
    sources: tuple[Source, ...]
    views: tuple[View, ...]
    """One for each source."""
    links: dict[Candidate, Link]
    """Every pair that was tried."""

    @property
    def groups(self) -> list[list[int]]:
        """The views that links join directly or through others, the largest group first."""
        return groups(len(self.views), valid_links(self.links))


def link_all(described: LinkedViews) -> LinkedViews:
    """Link likely pairs, then what the layout predicts; groups that stay isolated get a second look."""
    surveyor, views = described.surveyor, described.views
    votes = surveyor.count_votes(views)
    links = surveyor.link(views, first_candidates(views, votes) | surveyor.given.keys())
    _add_predicted(surveyor, views, links)
    # Thumbnails last: they serve only the groups that more features could not join.
    links |= link_by_more_features(surveyor, described.sources, views, links, votes)
    links |= link_across_heights(surveyor, views, links)
    links |= link_by_coarse_detail(surveyor, views, links)
    _add_predicted(surveyor, views, links)
    return replace(described, links=links)


def _add_predicted(surveyor: Surveyor, views: Sequence[View], links: dict[Candidate, Link]) -> None:
    """Add links that the present layout predicts: closed loops, and neighbours that were not candidates before."""
    for _ in range(MAX_ROUNDS):
        rough = rough_layouts(views, links)
        pairs = {pair for transforms in rough for pair in predicted(views, transforms, links)}
        if not pairs:
            return
        links |= surveyor.link(views, pairs)


def rough_layouts(views: Sequence[View], links: Mapping[Candidate, Link]) -> list[dict[int, Array]]:
    """Lay out each group of more than two views by similarities, exact enough to predict which of them overlap.

    Of two, the only link tells all, so a layout could neither predict another nor judge this one.
    """
    valid = valid_links(links)
    linked = [linked_group(views, part, valid) for part in groups(len(views), valid) if len(part) > 2]
    return [group.to_ground(group.start) for group in linked]
