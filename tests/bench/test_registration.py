"""The rows of the registration bench say of each group what was right, what was wrong at any seed, and the time."""

from bench.methods import REFERENCE
from bench.registration import Outcome, group_rows, method_row
from skymosaic.evaluation.metrics import MISSING_ERROR_PX

OURS = [Outcome("dark_2", (0.5, 2.0), 0.1), Outcome("dark_2", (0.5, 21.0), 0.2), Outcome("small_55", (4.0, 4.0), 0.3)]
SIFT = [Outcome("dark_2", (MISSING_ERROR_PX,), 0.4), Outcome("dark_2", (0.2,), 0.4), Outcome("small_55", (0.2,), 0.2)]


def test_a_group_has_shares_what_was_wrong_and_the_time_beside_sift() -> None:
    dark, small = group_rows({"ours": OURS, REFERENCE: SIFT})
    assert dark["ours"] == "50 (0-100) / 75 (50-100) / 75 (50-100), 1.25 px"
    # The refused pair is not wrong, and has no share.
    assert dark[REFERENCE] == "50 / 50 / 50, 500.10 px"
    assert (dark["pairs"], dark["wrong"], dark["time"]) == ("dark 2", 1, "0.38")
    assert (small["ours"], small["wrong"], small["time"]) == ("0 / 0 / 100, 4.00 px", 0, "1.50")


def test_a_method_without_a_reference_has_its_time_in_ms() -> None:
    row = method_row({"ours": OURS}, "ours")
    assert (row["dark_2"], row["wrong"], row["refused"], row["time"]) == (
        "50 (0-100) / 75 (50-100) / 75 (50-100)",
        1,
        0.0,
        "200 ms",
    )
