"""No text of a file ends a report."""

import json
from pathlib import Path
from xml.etree import ElementTree as XmlTree

import numpy as np

from skymosaic.maps.features import Place, write_places
from skymosaic.reports import pages

NAME = "a\udcff\x1b[31m<b>&\x00.jpg"


def test_names_that_are_no_text_are_shown_and_written(tmp_path: Path) -> None:
    page = pages.render("pair.html", title=NAME, rows=[("name", f"{NAME}\nsecond")], pictures={})
    pages.write_report_files(tmp_path, {"name": NAME}, page)
    shown = (tmp_path / "index.html").read_text(encoding="utf-8")
    assert "\\udcff\\x1b[31m&lt;b&gt;&amp;\\x00.jpg" in shown
    assert json.loads((tmp_path / "report.json").read_bytes())["name"] == NAME
    write_places(tmp_path / "p.kml", NAME, [Place(NAME, "Polygon", np.zeros((5, 2)))])
    kml = XmlTree.fromstring((tmp_path / "p.kml").read_bytes())
    assert [each.text for each in kml.iter() if each.tag.endswith("name")] == ["a\\udcff\\x1b[31m<b>&\\x00.jpg"] * 2


def test_values_are_escaped_once_also_in_macros(tmp_path: Path) -> None:
    (tmp_path / "rows.html").write_text("{% macro row(name) %}<b>{{ name }}</b>{% endmacro %}{{ row(name) }}")
    assert pages.open_templates(tmp_path).get_template("rows.html").render(name="<i>") == "<b>&lt;i&gt;</b>"
