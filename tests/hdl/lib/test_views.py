from amaranth.lib import data

from hdl.lib.views import view_signal

LAYOUT = data.StructLayout({"x": 4, "y": 4})


def test_the_signal_has_the_name_of_its_variable_or_the_one_that_was_given() -> None:
    position = view_signal(LAYOUT)
    assert position.as_value().name == "position"
    assert view_signal(LAYOUT, name="other").as_value().name == "other"
