"""Templates of the pages: values are escaped, and their own markup is not."""

from types import SimpleNamespace

from skymosaic.panel.pages.page_layout import fill_in


def test_the_numbers_are_tables_and_names_are_escaped() -> None:
    markup = fill_in(
        "numbers.html",
        counts={"corners, left": 10, "corners, right": 0},
        pair=SimpleNamespace(homography=[[1.0, 0, 0]] * 3, reason=""),
        homography="projective",
        quality={"computed by": "golden"},
        correct_px=3.0,
        seconds={"reading": 0.5},
        facts={"map": "<b>here</b>"},
    )
    assert markup.count("<table") == 5
    assert markup.count("<tr>") == 2 + 3 + 1 + 1 + 1
    assert "&lt;b&gt;here" in markup
    assert "&lt;t" not in markup
