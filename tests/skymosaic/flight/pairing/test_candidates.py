from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from skymosaic.flight.linking.links import Link
from skymosaic.flight.pairing.candidates import MAX_PREDICTED, MIN_GAIN, MIN_OVERLAP, first_candidates, predicted
from skymosaic.imagery.exif import Position

SIZE_PX = (400, 300)
COLUMNS, ROWS, STEP_PX = 8, 6, (60, 70)


def grid() -> tuple[list[Any], dict[int, NDArray[np.float64]]]:
    """Views of a dense survey, each overlapped by dozens of others, flown in rows to and fro, not quite regularly."""
    rng = np.random.default_rng(4)
    transforms = {}
    for view in range(COLUMNS * ROWS):
        row, column = divmod(view, COLUMNS)
        column = column if row % 2 == 0 else COLUMNS - 1 - column
        x, y = np.array([column, row]) * STEP_PX + rng.uniform(-8, 8, 2)
        transforms[view] = np.array([[1.0, 0, x], [0, 1, y], [0, 0, 1]])
    return [SimpleNamespace(working_size=SIZE_PX)] * len(transforms), transforms


def overlap(transforms: dict[int, NDArray[np.float64]], left: int, right: int) -> float:
    """Share of two views, which are rectangles between the centres of their corner pixels."""
    sides = np.array(SIZE_PX) - 1
    return float(np.prod(np.maximum(1 - np.abs(transforms[left] - transforms[right])[:2, 2] / sides, 0)))


def link(transforms: dict[int, NDArray[np.float64]], left: int, right: int) -> Link:
    """A link with as many ties as the overlap allows; it does not hold where there is too little."""
    share = overlap(transforms, left, right)
    ties = np.zeros((int(300 * share) if share > 0.15 else 0, 2))
    return Link(left, right, ties, ties, len(ties), len(ties))


def resistances(links: dict[tuple[int, int], Link]) -> NDArray[np.float64]:
    """Resistance between every two views, by the pseudo-inverse of the network's Laplacian matrix."""
    laplacian = np.zeros((COLUMNS * ROWS,) * 2)
    for (left, right), each in links.items():
        laplacian[[left, right], [right, left]] -= each.ties
        laplacian[[left, right], [left, right]] += each.ties
    # One eigenvalue is 0 but for rounding, which depends on the BLAS.
    inverse = np.linalg.pinv(laplacian, rcond=1e-12, hermitian=True)
    return np.diag(inverse)[:, None] + np.diag(inverse) - 2 * inverse


def survey(rounds: int) -> tuple[Any, ...]:
    """The links of the grid: neighbours in the order of the flight, then so many rounds of predicted pairs."""
    views, transforms = grid()
    pairs = [(view, view + step) for step in (1, 2) for view in range(len(views) - step)]
    links = {pair: link(transforms, *pair) for pair in pairs}
    for _ in range(rounds):
        links |= {pair: link(transforms, *pair) for pair in predicted(views, transforms, links)}
    return views, transforms, links


def test_a_dense_survey_is_tied_by_about_ten_links_per_photograph() -> None:
    views, transforms, links = survey(6)
    degree = np.bincount(np.array([pair for pair, each in links.items() if each.holds]).ravel())
    possible = 2 * sum(link(transforms, i, j).holds for i in range(len(views)) for j in range(i)) / len(views)
    assert 8 < degree.mean() < 12
    assert possible > 2.5 * degree.mean()
    assert predicted(views, transforms, links) == set()


@pytest.mark.parametrize("rounds", [0, 2])
def test_each_view_proposes_the_pairs_with_the_largest_gain(rounds: int) -> None:
    views, transforms, links = survey(rounds)
    shares = np.array([[overlap(transforms, left, right) for right in transforms] for left in transforms])
    full = np.median([each.ties / max(shares[pair], MIN_OVERLAP) for pair, each in links.items() if each.holds])
    gains = shares * full * resistances(links)
    gains[shares < MIN_OVERLAP] = 0
    for left, right in links:
        gains[left, right] = gains[right, left] = 0
    expected = set()
    for view, row in enumerate(gains):
        best = np.argsort(-row)[:MAX_PREDICTED].tolist()
        expected |= {(min(view, other), max(view, other)) for other in best if row[other] >= MIN_GAIN}
    assert len(expected) > 20
    assert predicted(views, transforms, links) == expected


def test_the_first_round_joins_rows() -> None:
    _, _, links = survey(1)
    across = [abs(left // COLUMNS - right // COLUMNS) for left, right in links if right - left > 2]
    assert len(across) > 20
    assert min(across) >= 1


def test_views_of_another_group_are_not_proposed() -> None:
    views, transforms, links = survey(0)
    inside = {view: transform for view, transform in transforms.items() if view < 2 * COLUMNS}
    links = {pair: each for pair, each in links.items() if (pair[0] in inside) == (pair[1] in inside)}
    pairs = predicted(views, inside, links)
    assert pairs
    assert {view for pair in pairs for view in pair} <= set(inside)


def test_first_candidates_are_neighbours_in_order_by_gps_and_by_votes() -> None:
    views: list[Any] = [SimpleNamespace(gps=None) for _ in range(8)]
    votes = np.zeros((8, 8), dtype=np.int16)
    votes[0, 6] = votes[6, 0] = 9
    votes[0, 7] = votes[7, 0] = 8
    in_order = {(i, i + step) for step in (1, 2) for i in range(8 - step)}
    assert first_candidates(views, votes) == in_order | {(0, 6)}
    # Six of the cameras stand apart and two together, so these two are each other's neighbours, too.
    for number, view in enumerate(views):
        view.gps = Position(45 + 0.01 * (number % 7), 7.0)
    assert (0, 7) in first_candidates(views, votes)


def test_each_view_proposes_its_four_nearest_and_the_four_that_resemble_it_most() -> None:
    votes = np.zeros((12, 12), dtype=np.int16)
    votes[0, 5:11] = 9, 20, 19, 18, 17, 9
    # On a line, whose steps grow, the nearest are those before; a view without GPS has none.
    places = [1.0 * number**2 for number in range(11)]
    views: list[Any] = [SimpleNamespace(gps=Position(45 + 1e-4 * place, 7.0)) for place in places]
    views.append(SimpleNamespace(gps=None))
    found = first_candidates(views, votes)
    in_order = {(i, i + step) for step in (1, 2) for i in range(12 - step)}
    by_votes = {(0, 6), (0, 7), (0, 8), (0, 9)}
    by_gps = set()
    for view, place in enumerate(places):
        near = sorted((abs(other - place), each) for each, other in enumerate(places) if each != view)[:4]
        by_gps |= {(min(view, each), max(view, each)) for _, each in near}
    assert found == in_order | by_votes | by_gps


@pytest.mark.parametrize(("share", "pairs"), [(0.08, set()), (0.12, {(0, 2)})])
def test_pairs_of_little_overlap_are_not_proposed(share: float, pairs: set[Any]) -> None:
    views: list[Any] = [SimpleNamespace(working_size=SIZE_PX)] * 3
    step_px = (1 - share) / 2 * (SIZE_PX[0] - 1)
    transforms = {view: np.array([[1.0, 0, step_px * view], [0, 1, 0], [0, 0, 1]]) for view in range(3)}
    ties = np.zeros((50, 2))
    links = {pair: Link(*pair, ties, ties, 50, 50) for pair in ((0, 1), (1, 2))}
    assert overlap(transforms, 0, 2) == pytest.approx(share)
    assert predicted(views, transforms, links) == pairs
