from types import SimpleNamespace

import numpy as np

from skymosaic.flight.candidates import predicted
from skymosaic.flight.linking.links import Link

SIZE_PX = (400, 300)
COLUMNS, ROWS, STEP_PX = 8, 6, (60, 70)


def grid():
    """Views of a dense survey, each overlapped by dozens of others, flown in rows to and fro."""
    columns = [column if row % 2 == 0 else COLUMNS - 1 - column for row in range(ROWS) for column in range(COLUMNS)]
    rows = np.repeat(np.arange(ROWS), COLUMNS).tolist()
    transforms = {}
    for view, (column, row) in enumerate(zip(columns, rows, strict=True)):
        transforms[view] = np.array([[1.0, 0, STEP_PX[0] * column], [0, 1, STEP_PX[1] * row], [0, 0, 1]])
    return [SimpleNamespace(working_size=SIZE_PX)] * len(transforms), transforms


def link(transforms, left, right):
    """A link with as many ties as the overlap allows; it does not hold where there is too little."""
    shift = np.abs(transforms[left][:2, 2] - transforms[right][:2, 2])
    share = np.prod(np.maximum(1 - shift / SIZE_PX, 0))
    ties = np.zeros((int(300 * share) if share > 0.15 else 0, 2))
    return Link(left, right, ties, ties, len(ties), len(ties))


def grown(rounds):
    views, transforms = grid()
    pairs = [(view, view + step) for step in (1, 2) for view in range(len(views) - step)]
    links = {each: link(transforms, *each) for each in pairs}
    for _ in range(rounds):
        links |= {each: link(transforms, *each) for each in predicted(views, transforms, links)}
    return views, transforms, links


def test_a_dense_survey_is_tied_by_about_ten_links_a_photograph():
    views, transforms, links = grown(6)
    degree = np.bincount(np.array([each for each, found in links.items() if found.holds]).ravel())
    possible = 2 * sum(link(transforms, i, j).holds for i in range(len(views)) for j in range(i)) / len(views)
    assert 8 < degree.mean() < 12
    assert possible > 2.5 * degree.mean()
    assert predicted(views, transforms, links) == set()


def test_what_the_network_lacks_comes_first():
    _, _, links = grown(1)
    across = [abs(left // COLUMNS - right // COLUMNS) for left, right in links if right - left > 2]
    assert len(across) > 20
    assert min(across) >= 1
