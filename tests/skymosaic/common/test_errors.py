import pytest

from skymosaic.common import errors


@pytest.mark.parametrize("name", [name for name in vars(errors) if name.endswith("Error") and name[0] != "_"])
def test_a_message_is_one_printable_line_for_any_name_of_a_file(name: str) -> None:
    message = str(getattr(errors, name)("two\nlines\x1b[2J.jpg: damaged"))
    assert message.isprintable()
    assert message.endswith(".jpg: damaged")


def test_of_several_outputs_each_that_fails_is_a_line() -> None:
    failures: list[str] = []
    for fault in (errors.OutputError("a.png: full"), OSError(28, "No space left", "b.csv"), None):
        with errors.noting(failures):
            if fault:
                raise fault
    assert failures == ["a.png: full", "b.csv: cannot be written (No space left); check the disk"]
    with pytest.raises(errors.RegistrationError), errors.noting(failures):
        raise errors.RegistrationError("no overlap")
