"""FCL, the Fuzzy Control Language of IEC 61131-7: zero-order Sugeno systems with one output, read and written."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator

import numpy as np

from skymosaic.fuzzy.fll import number, parse_rule
from skymosaic.fuzzy.system import FuzzySystem, IfThen, Input, Output
from skymosaic.fuzzy.terms import Term

AND = {"MIN": "minimum", "PROD": "product"}
SAMPLES = 65
"""Points that stand for a curve: FCL has straight lines only."""
_COMMENT = re.compile(r"\(\*.*?\*\)|//[^\n]*", re.DOTALL)
_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_POINT = re.compile(rf"\(\s*({_NUMBER})\s*,\s*({_NUMBER})\s*\)")
_RANGE = re.compile(rf"\(\s*({_NUMBER})\s*\.\.\s*({_NUMBER})\s*\)")
_SECTION = re.compile(
    r"\b(VAR_INPUT|VAR_OUTPUT|FUZZIFY|DEFUZZIFY|RULEBLOCK)\b(.*?)\bEND_(?:VAR|FUZZIFY|DEFUZZIFY|RULEBLOCK)\b",
    re.DOTALL | re.IGNORECASE,
)
_RULE = re.compile(r"RULE\s+\w+\s*:\s*(.+)", re.DOTALL | re.IGNORECASE)


def read_fcl(text: str) -> FuzzySystem:
    """The system that an FCL text describes.

    Terms are points or singletons. A range is that of ``RANGE := (LOW .. HIGH)``; an input without it reaches from
    the first to the last of its points, an output over its constants.

    Raises
    ------
    ValueError
        For what is malformed, or is no zero-order Sugeno system with one output and AND alone.
    """
    text = _COMMENT.sub(" ", text)
    header = re.search(r"\bFUNCTION_BLOCK\b[ \t]*(\w*)", text, re.IGNORECASE)
    if header is None:
        raise ValueError("has no FUNCTION_BLOCK")
    sections = [(kind.upper(), body) for kind, body in _SECTION.findall(text)]
    outputs = [body for kind, body in sections if kind == "DEFUZZIFY"]
    rule_blocks = [body for kind, body in sections if kind == "RULEBLOCK"]
    for kind, found in (("DEFUZZIFY", outputs), ("RULEBLOCK", rule_blocks)):
        if len(found) != 1:
            raise ValueError(f"has {len(found)} {kind} blocks; one is supported")
    output = _output(outputs[0])
    conjunction, rules = _rules(rule_blocks[0], output.name)
    return FuzzySystem(
        name=header[1] or "fuzzy",
        inputs=tuple(_input(body) for kind, body in sections if kind == "FUZZIFY"),
        output=output,
        rules=rules,
        conjunction=conjunction,
    )


def write_fcl(system: FuzzySystem) -> str:
    """The system as FCL text. A ``Sigmoid`` becomes straight lines between 65 points of its range."""
    output = system.output
    lines = [f"FUNCTION_BLOCK {system.name}", "VAR_INPUT"]
    lines += [f"  {variable.name} : REAL;" for variable in system.inputs]
    lines += ["END_VAR", "VAR_OUTPUT", f"  {output.name} : REAL;", "END_VAR"]
    for variable in system.inputs:
        lines += [f"FUZZIFY {variable.name}"]
        for term in variable.terms.values():
            points = " ".join(f"({number(x)}, {number(y)})" for x, y in _points(term, variable))
            lines.append(f"  TERM {term.name} := {points};")
        lines += [f"  RANGE := ({number(variable.low)} .. {number(variable.high)});", "END_FUZZIFY"]
    lines += [f"DEFUZZIFY {output.name}"]
    lines += [f"  TERM {name} := {number(value)};" for name, value in output.constants.items()]
    default = "NC" if math.isnan(output.default) else number(output.default)
    lines += ["  METHOD : COGS;", f"  DEFAULT := {default};"]
    lines += [f"  RANGE := ({number(output.low)} .. {number(output.high)});", "END_DEFUZZIFY", "RULEBLOCK rules"]
    lines += [f"  AND : {next(name for name, meaning in AND.items() if meaning == system.conjunction)};"]
    for index, rule in enumerate(system.rules, start=1):
        conditions = " AND ".join(f"{name} IS {chosen}" for name, chosen in rule.conditions.items())
        lines.append(f"  RULE {index} : IF {conditions} THEN {output.name} IS {rule.conclusion};")
    return "\n".join([*lines, "END_RULEBLOCK", "END_FUNCTION_BLOCK"]) + "\n"


def _statements(body: str) -> tuple[str, list[str]]:
    """The name at the head of a block, and its statements."""
    name, *rest = body.split(maxsplit=1)
    statements = [" ".join(statement.split()) for statement in (rest[0] if rest else "").split(";")]
    return name, [statement for statement in statements if statement]


def _assigned(statements: list[str], block: str) -> Iterator[tuple[str, str, str]]:
    """Keyword, name and value of each ``TERM name := value``, ``RANGE := value`` or ``METHOD : value``."""
    for statement in statements:
        left, sign, value = (part.strip() for part in statement.partition(":"))
        if not sign:
            raise ValueError(f"{block}: {statement!r} is not of the form NAME := VALUE")
        keyword, _, name = left.partition(" ")
        yield keyword.upper(), name.strip(), value.removeprefix("=").strip()


def _input(body: str) -> Input:
    name, statements = _statements(body)
    terms: dict[str, Term] = {}
    span = None
    for keyword, term, value in _assigned(statements, name):
        if keyword == "TERM":
            terms[term] = _term(name, term, value)
        elif keyword == "RANGE":
            span = _span(name, value)
        else:
            raise ValueError(f"{name}: {keyword} is not known; TERM and RANGE are")
    positions = [position for each in terms.values() for position in each.parameters[::2]]
    if not positions:
        raise ValueError(f"{name}: has no TERM")
    low, high = span or (min(positions), max(positions))
    return Input(name, low, high, terms)


def _term(variable: str, name: str, value: str) -> Term:
    points = _POINT.findall(value)
    if not points or _POINT.sub("", value).strip():
        raise ValueError(f"{variable}: term {name} is {value!r}; an input's terms are points (x, degree) ...")
    numbers = tuple(float(number) for point in points for number in point)
    if not all(0 <= degree <= 1 for degree in numbers[1::2]):
        raise ValueError(f"{variable}: term {name} has a degree outside 0 to 1")
    # One point is one degree everywhere.
    return Term(name, "Discrete", numbers if len(points) > 1 else numbers * 2)


def _output(body: str) -> Output:
    name, statements = _statements(body)
    constants: dict[str, float] = {}
    default, span = math.nan, None
    for keyword, term, value in _assigned(statements, name):
        if keyword == "TERM":
            if re.fullmatch(_NUMBER, value) is None:
                raise ValueError(f"{name}: term {term} is {value!r}; an output of order zero has numbers")
            constants[term] = float(value)
        elif keyword == "RANGE":
            span = _span(name, value)
        elif keyword == "DEFAULT":
            default = math.nan if value.upper() == "NC" else _real(name, value)
        elif keyword == "METHOD" and value.upper() != "COGS":
            raise ValueError(f"{name}: METHOD is {value}; COGS is supported, the mean of singletons")
        elif keyword not in ("METHOD", "ACCU"):
            raise ValueError(f"{name}: {keyword} is not known; TERM, METHOD, DEFAULT, RANGE and ACCU are")
    if not constants:
        raise ValueError(f"{name}: has no TERM")
    low, high = span or (min(constants.values()), max(constants.values()))
    return Output(name, low, high, constants, default)


def _rules(body: str, output: str) -> tuple[str, tuple[IfThen, ...]]:
    _, statements = _statements(body)
    conjunction, rules = "minimum", []
    for statement in statements:
        if match := _RULE.fullmatch(statement):
            rules.append(parse_rule(match[1], output))
            continue
        ((keyword, _, value),) = _assigned([statement], "RULEBLOCK")
        if keyword == "AND" and value.upper() not in AND:
            raise ValueError(f"AND is {value}; valid: {', '.join(AND)}")
        if keyword == "AND":
            conjunction = AND[value.upper()]
        elif keyword not in ("OR", "ACT", "ACCU"):
            raise ValueError(f"RULEBLOCK: {keyword} is not known; AND, OR, ACT, ACCU and RULE are")
    return conjunction, tuple(rules)


def _span(name: str, value: str) -> tuple[float, float]:
    found = _RANGE.fullmatch(value)
    if found is None:
        raise ValueError(f"{name}: RANGE is {value!r}; give (LOW .. HIGH)")
    return float(found[1]), float(found[2])


def _real(name: str, value: str) -> float:
    try:
        return float(value)
    except ValueError:
        raise ValueError(f"{name}: {value!r} is not a number") from None


def _points(term: Term, variable: Input) -> list[tuple[float, float]]:
    """A term as the points of a line."""
    if term.shape == "Discrete":
        return list(zip(term.parameters[::2], term.parameters[1::2], strict=True))
    if term.shape == "Sigmoid":
        xs = np.linspace(variable.low, variable.high, SAMPLES)
        return [(float(x), float(y)) for x, y in zip(xs, term.degree(xs), strict=True)]
    if term.shape == "Ramp":
        return sorted(zip(term.parameters, (0.0, 1.0), strict=True))
    left, right = term.parameters[0], term.parameters[-1]
    top = term.parameters[1:-1] or term.parameters
    # An edge at infinity is flat: the line has no point there, and goes on as it starts.
    line = [(left, 0.0), *((x, 1.0) for x in (top[0], top[-1])), (right, 0.0)]
    return [point for index, point in enumerate(line) if math.isfinite(point[0]) and point not in line[:index]]
