import csv
import io

import numpy as np
import pytest

from skymosaic.thesis.measurements import Measurement, Measurements


def test_means_and_pooled_shares_by_hand() -> None:
    lines = [
        Measurement("T", "s", "a", "one", {"good": 1, "matches": 2}),
        Measurement("T", "s", "b", "two", {"good": 3, "matches": 10}),
        Measurement("T", "s", "c", "two", {"matches": 6}),
        Measurement("T", "other", "c", "two", {"matches": 50, "good": 9}),
        Measurement("U", "s", "a", "one", {"matches": 70, "good": 9, "none": 0}),
    ]
    found = Measurements(lines)
    assert found.number("T", "s", "good") == 2
    assert found.mean("T", "s", "matches", "two") == 8
    assert found.number("T", "s", "matches-good") == 4
    assert found.number("T", "s", "good / matches") == pytest.approx(4 / 18)
    assert found.number("T", "s", "matches-good / matches+good") == pytest.approx(14 / 22)
    assert np.isnan(found.number("T", "s", "seconds"))
    assert np.isnan(found.number("T", "s", "good / seconds"))
    assert np.isnan(found.number("U", "s", "good / none"))
    assert (found.groups, found.pairs) == (["one", "two"], ["a", "b", "c"])
    assert (found.settings("T"), found.settings("U")) == (["s", "other"], ["s"])


def test_the_csv_holds_every_value(measured: Measurements) -> None:
    rows = list(csv.DictReader(io.StringIO(measured.to_csv())))
    assert len(rows) == sum(len(line.values) for line in measured.lines)
    assert set(rows[0]) == {"table", "setting", "pair", "group", "quantity", "value"}
