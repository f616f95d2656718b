"""An explanation as HTML: the verdict, the membership curves, the rules. The panel's own words and numbers only."""

from __future__ import annotations

from html import escape

from skymosaic.panel.drawings import membership
from skymosaic.panel.explain import Explanation, FiredRule, Input

MOST_RULES = 8
"""Of larger rule bases only the rules that speak are shown."""


def markup(explanation: Explanation) -> str:
    """The explanation of one match."""
    facts = "".join(f"<dt>{escape(name)}</dt><dd>{escape(value)}</dd>" for name, value in explanation.facts)
    words = (
        f'<div class="verdict"><p class="reason {explanation.verdict}">{escape(explanation.reason)}</p>'
        f"<dl>{facts}</dl></div>"
    )
    curves = "".join(map(_input, explanation.inputs))
    every = len(explanation.rules) <= MOST_RULES
    rules = "".join(_rule(rule) for rule in explanation.rules if every or rule.strength > 0)
    if not rules:
        return words
    return (
        f'{words}<div class="curves">{curves}</div><table class="rules"><thead><tr><th>rule</th><th>says</th>'
        f"<th>strength</th></tr></thead><tbody>{rules}</tbody></table>"
    )


def _input(item: Input) -> str:
    degrees = ", ".join(
        f'<b class="{kind}">{escape(name)} {degree:.2f}</b>'
        for kind, (name, degree) in zip(("first", "second", "third"), item.degrees.items(), strict=False)
    )
    caption = f"{escape(item.variable.name)} {item.value}: {degrees}"
    return f"<figure>{membership(item)}<figcaption>{caption}</figcaption></figure>"


def _rule(rule: FiredRule) -> str:
    kind = ' class="loudest"' if rule.loudest else ""
    return (
        f"<tr{kind}><td>{escape(rule.words)}</td><td>{rule.output:.2f}</td>"
        f'<td><span class="bar-of" style="--share:{rule.strength:.3f}"></span>{rule.strength:.2f}</td></tr>'
    )
