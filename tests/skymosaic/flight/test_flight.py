"""What a flight says of its photographs, on flights without any."""

from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from skymosaic.flight.flight import BLURRED, Flight
from skymosaic.flight.layout.layout import Layout
from skymosaic.flight.linking.links import Link

TIES = np.arange(40.0).reshape(20, 2)


def link(left: int, right: int, ties: int = 20) -> Link:
    return Link(left, right, TIES[:ties], TIES[:ties], 20, 20)


def flown(sharpness: Sequence[Any], links: list[Link], layouts: list[Layout]) -> Flight:
    """A flight whose first photograph could not be read, so that indices of views and photographs differ."""
    count = len(sharpness)
    views = cast(Any, tuple(SimpleNamespace(sharpness=each, working_size=(400, 300)) for each in sharpness))
    sources = cast(Any, tuple(SimpleNamespace(index=view + 1, name=f"{view}.jpg") for view in range(count)))
    names = tuple("abcdefgh"[: count + 1])
    settings: Any = None
    return Flight(names, sources, views, tuple(links), tuple(layouts), {0: "unreadable"}, settings, {})


def laid_out(*members: int, links: tuple[Link, ...] = (), contradicting: tuple[Link, ...] = ()) -> Layout:
    transforms = {member: np.eye(3) for member in members}
    errors = tuple(np.full(2, float(link.right)) for link in links)
    return Layout(members, members[0], transforms, links, contradicting, errors)


@pytest.mark.parametrize("blurred", [[], [1], [1, 3], [0, 2]], ids=str)
def test_what_is_sharp_elsewhere_on_the_same_ground_is_blurred(blurred: list[int]) -> None:
    """Four in a row, half of each on the next; sharpness belongs to the ground, and blurred ones link with each other.

    The last photograph is in no layout, so it is held against all.
    """
    ground = np.random.default_rng(1).normal(0, 1, 64).repeat(2)
    along = [ground[8 * view : 8 * view + 16] - 2.0 * (view in blurred) for view in range(4)]
    links = (link(0, 1), link(1, 2), link(2, 3), link(1, 3))
    places = {view: np.array([[1.0, 0, 200 * view], [0, 1, 0], [0, 0, 1]]) for view in range(4)}
    layout = Layout((0, 1, 2, 3), 0, places, links)
    sharpness = [np.array([each] * 12, np.float32) for each in (*along, np.full(16, -9.0))]
    flight = flown(sharpness, [], [layout])
    assert np.flatnonzero(flight.relative_sharpness < BLURRED).tolist() == [*blurred, 4]
    named = ", ".join(f"{view}.jpg" for view in blurred)
    assert flight.describe_blurred(layout).partition(":")[0] == named


def test_a_layout_without_some_views_keeps_what_joins_the_others() -> None:
    links, other = (link(0, 1), link(1, 2), link(2, 3)), (link(0, 2), link(1, 3))
    rest = laid_out(0, 1, 2, 3, links=links, contradicting=other).without([0])
    assert (rest.members, rest.reference, list(rest.transforms)) == ((1, 2, 3), 1, [1, 2, 3])
    assert (rest.links, rest.contradicting) == (links[1:], other[1:])
    assert [errors[0] for errors in rest.errors_px] == [2, 3]
    assert rest.without([3]).reference == 1
    assert laid_out(0, 1).without([0, 1]).members == ()


def test_photographs_that_are_taken_out_are_left_out_with_the_reason() -> None:
    flight = flown([1.0] * 6, [], [laid_out(0, 1, 2, 3), laid_out(4, 5)])
    assert flight.without({}) is flight
    rest = flight.without({3: "changed", 4: "gone"})
    # A single photograph is no mosaic.
    assert [layout.members for layout in rest.layouts] == [(0, 1, 2)]
    assert rest.left_out == {0: "unreadable", 4: "changed", 5: "gone"}
    assert [layout.members for layout in flight.without({0: "", 1: ""}).layouts] == [(2, 3), (4, 5)]


def test_what_is_in_another_group_is_absent_with_the_links_that_contradict() -> None:
    groups = [laid_out(0, 1, 2), laid_out(3, 4)]
    flight = flown([1.0] * 5, [link(0, 1), link(1, 3), link(2, 4), link(0, 4, ties=1)], groups)
    why = "in another group of 2 photographs, whose links to it (2) contradict"
    assert flight.absent_from(groups[0]) == {0: "unreadable", 4: f"3.jpg: {why}", 5: f"4.jpg: {why}"}
    assert list(flight.absent_from(groups[1])) == [0, 1, 2, 3]
