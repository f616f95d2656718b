from tests.fuzz.fuzz import fuzz


def test_a_slice_of_the_mutated_files() -> None:
    report = fuzz(200)
    assert report.failures == [], report.failures[0]
    assert report.classes.total() == 200
    assert report.slowest_seconds < 20
