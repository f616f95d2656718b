"""Writes an explanation as HTML: the verdict, the membership curves and the rules.

It contains the panel's own words and numbers only, never text from an uploaded file.
"""

from html import escape

from skymosaic.panel.explain import Explanation, FiredRule, Input
from skymosaic.panel.pages.drawings import plot_membership

MAX_RULES = 8
"""Larger rule bases are shown with only the rules that fire."""


def write_html(explanation: Explanation) -> str:
    """Write one explanation as HTML."""
    facts = "".join(f"<dt>{escape(name)}</dt><dd>{escape(value)}</dd>" for name, value in explanation.facts)
    words = (
        f'<div class="verdict"><p class="reason {explanation.verdict}">{escape(explanation.reason)}</p>'
        f"<dl>{facts}</dl></div>"
    )
    curves = "".join(map(_write_input, explanation.inputs))
    show_all = len(explanation.rules) <= MAX_RULES
    rules = "".join(_write_rule(rule) for rule in explanation.rules if show_all or rule.strength > 0)
    if not rules:
        return words
    return (
        f'{words}<div class="curves">{curves}</div><table class="rules"><thead><tr><th>rule</th><th>output</th>'
        f"<th>strength</th></tr></thead><tbody>{rules}</tbody></table>"
    )


def _write_input(item: Input) -> str:
    degrees = ", ".join(
        f'<b class="{kind}">{escape(name)} {degree:.2f}</b>'
        for kind, (name, degree) in zip(("first", "second", "third"), item.degrees.items(), strict=False)
    )
    caption = f"{escape(item.variable.name)} {item.value}: {degrees}"
    return f"<figure>{plot_membership(item)}<figcaption>{caption}</figcaption></figure>"


def _write_rule(rule: FiredRule) -> str:
    kind = ' class="dominant"' if rule.dominant else ""
    return (
        f"<tr{kind}><td>{escape(rule.words)}</td><td>{rule.output:.2f}</td>"
        f'<td><span class="bar-of" style="--share:{rule.strength:.3f}"></span>{rule.strength:.2f}</td></tr>'
    )
