import pytest

from skymosaic.common import errors


@pytest.mark.parametrize("name", [name for name in vars(errors) if name.endswith("Error") and name[0] != "_"])
def test_a_message_is_one_printable_line_for_any_name_of_a_file(name: str) -> None:
    message = str(getattr(errors, name)("two\nlines\x1b[2J.jpg: damaged"))
    assert message.isprintable()
    assert message.endswith(".jpg: damaged")
