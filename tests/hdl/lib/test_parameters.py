import pytest

from hdl.lib.parameters import check_choice, check_range


@pytest.mark.parametrize(("value", "refused"), [(1, False), (2, True), (3, False), (0, True), (4, True)])
def test_a_choice_is_one_of_those_that_there_are(value: int, refused: bool) -> None:
    if refused:
        with pytest.raises(ValueError, match=f"radius_px is {value}; valid: 1, 3"):
            check_choice("radius_px", value, (1, 3))
    else:
        check_choice("radius_px", value, (1, 3))


@pytest.mark.parametrize(("value", "most", "says"), [(3, 8, "4 to 8"), (9, 8, "4 to 8"), (3, None, "at least 4")])
def test_a_range_holds_its_ends_and_nothing_beyond(value: int, most: int | None, says: str) -> None:
    check_range("bits", 4, 4, most)
    check_range("bits", 8, 4, most)
    with pytest.raises(ValueError, match=f"bits is {value}; it must be {says}"):
        check_range("bits", value, 4, most)
