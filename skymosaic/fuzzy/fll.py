"""FLL, the FuzzyLite Language: zero-order Sugeno systems with one output, read and written."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import TypeVar

from skymosaic.fuzzy.system import FuzzySystem, IfThen, Input, Output
from skymosaic.fuzzy.terms import Term

AND = {"Minimum": "minimum", "AlgebraicProduct": "product"}
DEFUZZIFIERS = ("WeightedAverage", "WeightedAverage TakagiSugeno", "WeightedAverage Automatic")
BLOCKS = ("Engine", "InputVariable", "OutputVariable", "RuleBlock")
WITHOUT_EFFECT = {"description", "enabled", "lock-range", "aggregation", "disjunction", "implication", "lock-previous"}
"""Keys that change nothing in a Sugeno system; a value that would matter is refused in `_check`."""

Result = TypeVar("Result")


@dataclass
class _Block:
    kind: str
    name: str
    line: int
    entries: list[tuple[int, str, str]] = field(default_factory=list)

    def all(self, key: str) -> Iterator[tuple[int, str]]:
        """Line and value of each entry with this key."""
        return ((line, value) for line, found, value in self.entries if found == key)

    def one(self, key: str, default: str) -> str:
        """The last value with this key."""
        return ([default, *(value for _, value in self.all(key))])[-1]


def read_fll(text: str) -> FuzzySystem:
    """The system that an FLL text describes.

    Raises
    ------
    ValueError
        With the line, for what is malformed, or is no zero-order Sugeno system with one output and AND alone.
    """
    blocks = _blocks(text)
    inputs = [_input(block) for block in blocks if block.kind == "InputVariable"]
    outputs = [block for block in blocks if block.kind == "OutputVariable"]
    rule_blocks = [block for block in blocks if block.kind == "RuleBlock"]
    for kind, found in (("output variable", outputs), ("rule block", rule_blocks)):
        if len(found) != 1:
            raise ValueError(f"has {len(found)} {kind}s; one is supported")
    (rules,) = rule_blocks
    conjunction = rules.one("conjunction", "none")
    if conjunction not in AND:
        raise ValueError(f"line {rules.line}: conjunction is {conjunction}; valid: {', '.join(AND)}")
    if rules.one("activation", "General") != "General":
        raise ValueError(f"line {rules.line}: activation is {rules.one('activation', '')}; General is supported")
    output = _output(outputs[0])
    engine = next((block for block in blocks if block.kind == "Engine"), None)
    return FuzzySystem(
        name=engine.name if engine else "",
        inputs=tuple(inputs),
        output=output,
        rules=tuple(_at(line, parse_rule, value, output.name) for line, value in rules.all("rule")),
        conjunction=AND[conjunction],
        description=engine.one("description", "") if engine else "",
    )


def parse_rule(text: str, output: str) -> IfThen:
    """A rule of FLL or FCL: ``if A is x and B is y then OUTPUT is z``, in capitals or not.

    Raises
    ------
    ValueError
        For anything else, such as ``or``, ``not`` or a weight.
    """
    words = text.replace("(", " ").replace(")", " ").replace(";", " ").split()
    small = [word.lower() for word in words]
    if small[:1] != ["if"] or small.count("then") != 1:
        raise ValueError(f"rule {text.strip()!r} is not of the form: if A is x and B is y then {output} is z")
    refused = {"or", "not", "with", "any", "very", "somewhat", "extremely", "seldom"}.intersection(small)
    if refused:
        raise ValueError(f"rule {text.strip()!r}: only AND of terms is supported, not {min(refused)}")
    end = small.index("then")
    conclusion = words[end + 1 :]
    if len(conclusion) != 3 or conclusion[0] != output or conclusion[1].lower() != "is":
        raise ValueError(f"rule {text.strip()!r}: what follows 'then' is not: {output} is CONSTANT")
    conditions: dict[str, str] = {}
    for start in range(1, end, 4):
        part, joint = words[start : start + 3], small[start + 3 : start + 4]
        if len(part) != 3 or part[1].lower() != "is" or joint not in (["and"], ["then"]) or part[0] in conditions:
            raise ValueError(f"rule {text.strip()!r}: {' '.join(part)!r} is not a condition of another input")
        conditions[part[0]] = part[2]
    return IfThen(conditions, conclusion[2])


def write_fll(system: FuzzySystem) -> str:
    """The system as FLL text, which `read_fll` and FuzzyLite read."""
    lines = [f"Engine: {_word(system.name)}", f"  description: {' '.join(system.description.split())}"]
    for variable in system.inputs:
        lines += _variable("InputVariable", variable.name, variable.low, variable.high)
        lines += [
            f"  term: {_word(term.name)} {term.shape} {' '.join(map(number, term.parameters))}"
            for term in variable.terms.values()
        ]
    output = system.output
    lines += _variable("OutputVariable", output.name, output.low, output.high)
    lines += [
        "  aggregation: none",
        "  defuzzifier: WeightedAverage TakagiSugeno",
        f"  default: {number(output.default)}",
    ]
    lines += ["  lock-previous: false"]
    lines += [f"  term: {_word(name)} Constant {number(value)}" for name, value in output.constants.items()]
    conjunction = next(name for name, meaning in AND.items() if meaning == system.conjunction)
    lines += ["RuleBlock: rules", "  enabled: true", f"  conjunction: {conjunction}", "  disjunction: none"]
    lines += ["  implication: none", "  activation: General"]
    for rule in system.rules:
        conditions = " and ".join(f"{name} is {chosen}" for name, chosen in rule.conditions.items())
        lines.append(f"  rule: if {conditions} then {output.name} is {rule.conclusion}")
    return "\n".join(lines) + "\n"


def number(value: float) -> str:
    """The shortest text that reads back as ``value``."""
    return repr(float(value)).removesuffix(".0")


def _variable(kind: str, name: str, low: float, high: float) -> list[str]:
    first = [f"{kind}: {_word(name)}", "  enabled: true", f"  range: {number(low)} {number(high)}"]
    return [*first, "  lock-range: false"]


def _word(name: str) -> str:
    """``name``, which must be one word to be read back."""
    if len(name.split()) != 1:
        raise ValueError(f"{name!r} is not one word; rename it")
    return name


def _blocks(text: str) -> list[_Block]:
    blocks: list[_Block] = []
    for line, row in enumerate(text.splitlines(), start=1):
        content = row.partition("#")[0].strip()
        if not content:
            continue
        key, colon, value = (part.strip() for part in content.partition(":"))
        if not colon:
            raise ValueError(f"line {line}: {content!r} is not of the form KEY: VALUE")
        if key in BLOCKS:
            blocks.append(_Block(key, value, line))
        elif not blocks:
            raise ValueError(f"line {line}: {key} comes before any of {', '.join(BLOCKS)}")
        else:
            _check(line, key, value)
            blocks[-1].entries.append((line, key, value))
    return blocks


def _check(line: int, key: str, value: str) -> None:
    known = {"range", "term", "rule", "conjunction", "activation", "defuzzifier", "default"} | WITHOUT_EFFECT
    if key not in known:
        raise ValueError(f"line {line}: {key} is not known; valid: {', '.join(sorted(known))}")
    if key in ("enabled", "lock-range", "lock-previous") and value != ("true" if key == "enabled" else "false"):
        raise ValueError(f"line {line}: {key} is {value}, which is not supported")


def _input(block: _Block) -> Input:
    low, high = _range(block)
    terms = [_at(line, _term, value) for line, value in block.all("term")]
    return Input(block.name, low, high, {term.name: term for term in terms})


def _term(text: str) -> Term:
    words = text.split()
    if len(words) < 2:
        raise ValueError(f"term {text!r} is not of the form: NAME SHAPE NUMBERS")
    name, shape, *parameters = words
    return Term(name, shape, tuple(float(value) for value in parameters))


def _output(block: _Block) -> Output:
    defuzzifier = block.one("defuzzifier", "none")
    if defuzzifier not in DEFUZZIFIERS:
        raise ValueError(f"line {block.line}: defuzzifier is {defuzzifier}; WeightedAverage is supported")
    low, high = _range(block)
    constants = dict(_at(line, _constant, value) for line, value in block.all("term"))
    return Output(block.name, low, high, constants, float(block.one("default", "nan")))


def _constant(text: str) -> tuple[str, float]:
    words = text.split()
    if len(words) != 3 or words[1] != "Constant":
        raise ValueError(f"term {text!r}: an output of order zero has terms of the form NAME Constant NUMBER")
    return words[0], float(words[2])


def _range(block: _Block) -> tuple[float, float]:
    for line, value in block.all("range"):
        low, high = _at(line, _two_numbers, value)
        return low, high
    return -math.inf, math.inf


def _two_numbers(text: str) -> tuple[float, float]:
    try:
        low, high = map(float, text.split())
    except ValueError:
        raise ValueError(f"range is {text!r}; give two numbers") from None
    return low, high


def _at(line: int, parse: Callable[..., Result], *arguments: str) -> Result:
    """What ``parse`` returns; an error gets the line."""
    try:
        return parse(*arguments)
    except ValueError as error:
        raise ValueError(f"line {line}: {error}") from None
