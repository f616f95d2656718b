"""A system's output, worked by hand."""

import numpy as np
import pytest

from golden_model.fuzzy.fll import read_fll
from tests.golden_model.fuzzy.valve import PRODUCT, VALVE


@pytest.mark.parametrize(
    ("text", "temp", "pressure", "valve"),
    [
        (VALVE, 3, 55, 100),
        (VALVE, 27, 95, -100),
        # cold 3/4, hot 1/4; low 1/2, high 1/2: strengths 1/2, 1/2, 1/4, 1/4; 100 (1/2 - 1/4) / (3/2)
        (VALVE, 9, 75, 100 / 6),
        # Beyond a ramp its end's degree holds: cold 1; low 1/4, high 3/4.
        (VALVE, -20, 85, 25),
        # cold 3/4, hot 1/4; low 1/4, high 3/4: products 3/16, 9/16, 1/16, 3/16; they sum to one.
        (PRODUCT, 9, 85, 0),
        # cold 1/4, hot 3/4; low 1/4, high 3/4: 100 (1/16 - 9/16)
        (PRODUCT, 21, 85, -50),
    ],
)
def test_the_output_is_what_was_worked_by_hand(text: str, temp: float, pressure: float, valve: float) -> None:
    assert read_fll(text).evaluate(np.array([temp]), np.array([pressure]))[0] == pytest.approx(valve)
