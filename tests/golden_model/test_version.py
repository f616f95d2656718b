from pathlib import Path

from golden_model.version import VERSION

CITATION = Path(__file__).parents[2] / "CITATION.cff"


def test_the_version_is_three_numbers_that_fit_the_register() -> None:
    numbers = [int(number) for number in VERSION.split(".")]
    assert len(numbers) == 3
    assert all(0 <= number < 256 for number in numbers)


def test_the_citation_has_the_version_of_the_package_and_names_the_thesis() -> None:
    assert f"\nversion: {VERSION}\n" in CITATION.read_text()
    assert "\nreferences:\n  - type: thesis\n" in CITATION.read_text()
