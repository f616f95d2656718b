from tests.fuzz.fuzz import fuzz


def test_a_slice_of_the_mutated_files() -> None:
    outcomes, failures, slowest = fuzz(200)
    assert failures == [], failures[0]
    assert outcomes.total() == 200
    assert slowest < 20
