"""Names of files, which may contain anything, are text in the pages of the reports."""

import jinja2
import pytest

from skymosaic.reports.pages import render

HOSTILE = "<img src=x onerror=alert(1)>'\"&{{ 7 * 7 }}"


def test_every_value_is_escaped() -> None:
    pair = render("pair.html", title=HOSTILE, rows=[(HOSTILE, HOSTILE)], pictures={HOSTILE: HOSTILE}).decode()
    line = {"x1": 0, "y1": 0, "x2": 1, "y2": 1, "colour": HOSTILE, "width": 1, "title": HOSTILE}
    graph = {"size": (90, 90), "outlines": [[(0.0, 0.0)]], "lines": [line], "names": [(HOSTILE, 1, 2)]}
    mosaic = {"rows": [(HOSTILE, HOSTILE)], "graph": graph, "links": [{"left": HOSTILE}]}
    names = {"title": HOSTILE, "rows": [], "left_out": [HOSTILE], "advice": [HOSTILE], "mosaics": [mosaic]}
    flight = render("flight.html", **names).decode()
    for page, times in ((pair, 7), (flight, 10)):
        assert "<img src=x" not in page
        assert page.count("&lt;img src=x onerror=alert(1)&gt;&#39;&#34;&amp;{{ 7 * 7 }}") == times


def test_a_value_that_is_missing_is_an_error() -> None:
    with pytest.raises(jinja2.UndefinedError, match="rows"):
        render("pair.html", title="pair", pictures={})
