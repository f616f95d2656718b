"""Every number of the page's tables and diagrams, of made-up measurements, as it was when it was looked at."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from matplotlib.figure import Figure

from skymosaic.thesis import charts, tables
from skymosaic.thesis.measurements import Measurements

RECORDED = Path(__file__).with_name("recorded_page.txt")
"""After a change that is meant, `write_out` of `made_up` writes it again."""


@pytest.fixture
def made_up(measured: Measurements) -> Measurements:
    """The lines of all experiments on two pairs, with falling numbers; of one setting, none."""
    lines = []
    for number, line in enumerate(measured.lines):
        for pair, group in enumerate(("along", "across")):
            top = 1200 - 20 * (number % 55) - 100 * pair
            found = {each: top / (1 + n) + n * number for n, each in enumerate(line.values)}
            values = {} if line.setting == "SIFT + SIFT" else found
            lines.append(replace(line, pair=f"pair {pair}", group=group, values=values))
    return Measurements(lines)


def write_out(m: Measurements) -> Iterator[str]:
    m = tables.scale_thresholds(m)
    for name, sheet in ((name, tables.tabulate(m, name)) for name in tables.TABLES):
        yield from (f"table {name}: {' | '.join(row)}" for row in (sheet[0], *(row.values() for row in sheet)))
    yield from (f"groups: {' | '.join(row.values())}" for row in tables.tabulate_groups(m, "IV-2", "px"))
    yield from (f"trend: {trend.statement} | {trend.holds} | {trend.numbers}" for trend in tables.check_trends(m))
    drawn: list[Figure] = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Figure, "savefig", lambda figure, *_, **__: drawn.append(figure))
        for draw in charts.CHARTS.values():
            draw(m)
    for name, figure in zip(charts.CHARTS, drawn, strict=True):
        every: list[Any] = figure.axes
        for legend in [*figure.legends, *filter(None, (axes.get_legend() for axes in every))]:
            yield f"diagram {name}: legend: {' | '.join(each.get_text() for each in legend.get_texts())}"
        for axes in every:
            words = axes.get_xlabel(), axes.get_xscale(), axes.get_ylabel(), axes.get_yscale()
            yield f"diagram {name}: {' '.join(words)} {' '.join(f'{each:.4g}' for each in axes.get_ylim())}"
            series: dict[str, Any] = {line.get_label(): line.get_xydata() for line in axes.lines}
            series |= {"bars": [(bar.get_x(), bar.get_height()) for bar in axes.patches]}
            series |= {"segments": [end for each in axes.collections for ends in each.get_segments() for end in ends]}
            for label, points in series.items():
                if len(points):
                    yield f"diagram {name}: {label}: {' '.join(f'{x:.3g},{y:.4g}' for x, y in points)}"
            if axes.texts:
                yield f"diagram {name}: {' '.join(text.get_text() for text in axes.texts)}"


def test_tables_and_diagrams_say_what_was_measured_and_published(made_up: Measurements) -> None:
    assert list(write_out(made_up)) == RECORDED.read_text(encoding="utf-8").splitlines()
