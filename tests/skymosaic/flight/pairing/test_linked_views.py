from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from skymosaic.flight.linking.links import Link
from skymosaic.flight.pairing import linked_views
from skymosaic.flight.pairing.linked_views import LinkedViews, link_all


def test_what_a_second_look_joins_predicts_further_links(monkeypatch: pytest.MonkeyPatch) -> None:
    points, asked = np.random.default_rng(0).uniform(100, 300, (40, 2)), list[set[tuple[int, int]]]()

    def tie(left: int, right: int) -> Link:
        return Link(left, right, points, points - [60 * (right - left), 0], 40, 40)

    def link(_views: Any, pairs: Any) -> dict[tuple[int, int], Link]:
        asked.append(set(pairs))
        return {pair: tie(*pair) for pair in pairs}

    monkeypatch.setattr("skymosaic.flight.pairing.linked_views.first_candidates", lambda *_: {(0, 1)})
    monkeypatch.setattr(linked_views, "link_by_more_features", lambda *_: {(1, 2): tie(1, 2)})
    for name in ("link_across_heights", "link_by_coarse_detail"):
        monkeypatch.setattr(linked_views, name, lambda *_: {})
    views: Any = [SimpleNamespace(size=(400, 300), working_size=(400, 300))] * 3
    stub: Any = SimpleNamespace(count_votes=lambda _views: None, link=link, given={})
    assert set(link_all(LinkedViews(stub, (), tuple(views), {})).links) == {(0, 1), (1, 2), (0, 2)}
    assert asked == [{(0, 1)}, {(0, 2)}]
