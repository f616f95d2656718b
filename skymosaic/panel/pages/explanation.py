"""Writes an explanation as HTML: the verdict, the membership curves and the rules."""

from collections.abc import Mapping

from golden_model.matching.fuzzy import ONE
from skymosaic.panel.explain import Explanation, Input
from skymosaic.panel.pages.page_layout import fill_in

MAX_RULES = 8
"""Larger rule bases are shown with only the rules that fire."""
WIDTH, HEIGHT = 210, 54
LEFT, TOP, RIGHT, BOTTOM = 16, 6, 202, 40
"""Ends of the axes in the plot of an input."""


def write_html(explanation: Explanation) -> str:
    """Write one explanation as HTML."""
    show_all = len(explanation.rules) <= MAX_RULES
    return fill_in(
        "explanation.html",
        explanation=explanation,
        size=(WIDTH, HEIGHT),
        ends=(LEFT, TOP, RIGHT, BOTTOM),
        plots=[_plot_membership(item) for item in explanation.inputs],
        rules=[rule for rule in explanation.rules if show_all or rule.strength > 0],
    )


def _plot_membership(item: Input) -> Mapping[str, object]:
    """The curves of an input's sets, with the match's value and its degrees marked."""
    last = max(item.variable.entries - 1, 1)

    def x(value: int) -> float:
        return LEFT + (RIGHT - LEFT) * value / last

    def y(degree: float) -> float:
        return TOP + (BOTTOM - TOP) * (1 - degree)

    terms = [
        {
            "name": name,
            "degree": item.degrees[name],
            "y": y(item.degrees[name]),
            "points": " ".join(f"{x(value):.1f},{y(degree / ONE):.1f}" for value, degree in enumerate(table.tolist())),
        }
        for name, table in item.variable.sets.items()
    ]
    marked = x(min(item.value, last))
    return {"name": item.variable.name, "value": item.value, "last": last, "x": marked, "terms": terms}
