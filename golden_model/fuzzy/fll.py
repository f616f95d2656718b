"""Reads FLL, the FuzzyLite Language: zero-order Sugeno systems, of several outputs one."""

import itertools
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TypeVar

from golden_model.fuzzy.fis import to_fll
from golden_model.fuzzy.sugeno import MAX_RULES
from golden_model.fuzzy.system import FuzzySystem, IfThen, Input, Output
from golden_model.fuzzy.terms import Term
from golden_model.small_files import read_small_file

AND = {"Minimum": "minimum", "AlgebraicProduct": "product"}
# The word behind the name changes nothing for rules with constants.
DEFUZZIFIERS = ("WeightedAverage", "WeightedAverage TakagiSugeno", "WeightedAverage Automatic")
SUFFIXES = (".fll", ".fis")
BLOCKS = ("Engine", "InputVariable", "OutputVariable", "RuleBlock")
MAX_BYTES = 1 << 24
"""Room for far more rules than are supported, so that the line of the first that is too many can be named."""
MAX_INPUTS, MAX_TERMS, MAX_PARAMETERS = 5, 16, 128
"""With these and 32 rules, checking a system takes less than 1 GB and 5 s."""
KEYS = {
    "Engine": {"description"},
    "InputVariable": {"description", "enabled", "lock-range", "range", "term"},
    "OutputVariable": {
        "aggregation", "default", "defuzzifier", "description", "enabled", "lock-previous", "lock-range", "range",
        "term",
    },
    "RuleBlock": {"activation", "conjunction", "description", "disjunction", "enabled", "implication", "rule"},
}  # fmt: skip
"""What each block may contain; some of it changes nothing in a Sugeno system, see `_check_entry`."""
REPEATED = {"term", "rule"}
MATCH = "match"
"""The output of several that is computed unless another is named."""
SUM = "UnboundedSum"
OR = ("Maximum", SUM)
HEDGES = {"not", "with", "any", "very", "somewhat", "extremely", "seldom"}
Result = TypeVar("Result")


@dataclass
class _Block:
    kind: str
    name: str
    line: int
    entries: list[tuple[int, str, str]] = field(default_factory=list)

    def find_all(self, key: str) -> Iterator[tuple[int, str]]:
        """Line number and value of each entry with this key."""
        return ((line, value) for line, entry_key, value in self.entries if entry_key == key)

    def get(self, key: str, default: str) -> str:
        """The value of this key."""
        return next((value for _, value in self.find_all(key)), default)


def load_system(path: Path, output: str | None = None) -> FuzzySystem:
    """Read a system from an ``.fll`` or ``.fis`` file; ``output`` as in `read_fll`.

    Raises
    ------
    ValueError
        For a file that cannot be read, or describes no zero-order Sugeno system; the message is one line that names it.
    """
    text = read_file(path)
    try:
        return read_fll(text, output)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None


def read_file(path: Path) -> str:
    """Read the text of an ``.fll`` file, or that of a ``.fis`` file in FLL.

    Raises
    ------
    ValueError
        For a file of another kind, one that cannot be read, or what `to_fll` refuses; the message is one line that
        names it.
    """
    if path.suffix.lower() not in SUFFIXES:
        raise ValueError(f"{path}: unknown kind of file; fuzzy systems end in {' or '.join(SUFFIXES)}")
    try:
        text = read_small_file(path, MAX_BYTES).decode("utf-8-sig")
        return text if path.suffix.lower() == ".fll" else to_fll(text)
    except OSError as error:
        raise ValueError(f"{path}: cannot be read ({error.strerror}); check the path") from None
    except UnicodeDecodeError:
        raise ValueError(f"{path}: is not text in UTF-8; save it as such") from None
    # Last, because UnicodeDecodeError is a ValueError, too.
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None


def read_fll(text: str, output: str | None = None) -> FuzzySystem:
    """Parse FLL text.

    Parameters
    ----------
    text : str
    output : str, optional
        Which of several outputs is computed; by default the one named ``match``.

    Raises
    ------
    ValueError
        For text that is malformed, or is no zero-order Sugeno system; with the line.
    """
    blocks = _split_blocks(text)
    inputs = [_parse_input(block) for block in blocks if block.kind == "InputVariable"]
    if len(inputs) > MAX_INPUTS:
        raise ValueError(f"has {len(inputs)} inputs; at most {MAX_INPUTS} are supported")
    outputs = [block for block in blocks if block.kind == "OutputVariable"]
    chosen, others = _choose_output(outputs, output), {block.name for block in outputs}
    rule_blocks = [block for block in blocks if block.kind == "RuleBlock"]
    if len(rule_blocks) != 1:
        raise ValueError(f"has {len(rule_blocks)} rule blocks; one is supported")
    _check_places(blocks)
    (rules,) = rule_blocks
    if rules.get("activation", "General") != "General":
        raise ValueError(f"line {rules.line}: activation is {rules.get('activation', '')}; General is supported")
    parsed = [
        replace(each, line=line)
        for line, value in rules.find_all("rule")
        for each in _parse_at(line, _parse_rule, value, chosen.name, others)
    ]
    conjunction = rules.get("conjunction", "none")
    if conjunction not in AND:
        joint = next((rule.line for rule in parsed if len(rule.conditions) > 1), None)
        if joint is not None or conjunction != "none":
            where = f"line {rules.line}" if joint is None else f"line {joint} needs AND, and line {rules.line}"
            raise ValueError(f"{where}: conjunction is {conjunction}; valid: {', '.join(AND)}")
    engine = next((block for block in blocks if block.kind == "Engine"), None)
    disjunction, split = rules.get("disjunction", "none"), [rule.line for rule in parsed if rule.joins]
    if split and disjunction not in OR:
        where = f"line {split[0]} needs OR, and line {rules.line}"
        raise ValueError(f"{where}: disjunction is {disjunction}; valid: {', '.join(OR)}")
    # Sums need no alternatives: each is a rule.
    if disjunction == SUM:
        parsed = [replace(rule, joins=False) for rule in parsed]
    return FuzzySystem(
        name=engine.name if engine else "",
        inputs=tuple(inputs),
        output=_parse_output(chosen),
        rules=tuple(parsed),
        # Where nothing is joined, either gives the same.
        conjunction=AND.get(conjunction, "minimum"),
        description=engine.get("description", "") if engine else "",
    )


def _choose_output(outputs: list[_Block], name: str | None) -> _Block:
    names = ", ".join(block.name for block in outputs)
    if name is None and len(outputs) == 1:
        return outputs[0]
    if not outputs:
        raise ValueError("has no output; add an OutputVariable")
    found = next((block for block in outputs if block.name == (name or MATCH)), None)
    if found is None and name is not None:
        raise ValueError(f"has no output {name}; there are {names}")
    if found is None:
        raise ValueError(f"has {len(outputs)} outputs, {names}; choose one, or name one {MATCH}")
    return found


def _parse_rule(text: str, output: str, outputs: set[str]) -> list[IfThen]:
    """Parse ``if A is x and B is y then OUTPUT is z``; the keywords may be in capitals.

    With ``or`` it is several rules; if it concludes on other outputs alone, none.
    """
    # Without OR, parentheses change nothing.
    words = text.replace("(", " ").replace(")", " ").split()
    lowered = [word.lower() for word in words]
    if lowered[:1] != ["if"] or lowered.count("then") != 1:
        raise ValueError(f"rule {text.strip()!r} is not of the form: if A is x and B is y then {output} is z")
    end = lowered.index("then")
    conclusions = _split_words(words[end + 1 :], "and")
    of_output = [part for part in conclusions if part[:1] == [output]]
    if not of_output and all(part and part[0] in outputs for part in conclusions):
        return []
    refused = HEDGES.intersection([*lowered[:end], *(word.lower() for part in of_output for word in part)])
    if refused:
        raise ValueError(f"rule {text.strip()!r}: terms stand alone here, without {min(refused)}")
    if len(of_output) != 1 or len(of_output[0]) != 3 or of_output[0][1].lower() != "is":
        raise ValueError(f"rule {text.strip()!r}: what follows 'then' is not: {output} is CONSTANT")
    if "or" in lowered[:end] and "(" in text:
        raise ValueError(f"rule {text.strip()!r}: 'or' with parentheses is not supported; write AND within OR")
    rules: list[IfThen] = []
    for alternative in _split_words(words[1:end], "or"):
        conditions: dict[str, str] = {}
        for part in _split_words(alternative, "and"):
            if len(part) != 3 or part[1].lower() != "is" or part[0] in conditions:
                raise ValueError(f"rule {text.strip()!r}: {' '.join(part)!r} is not a condition of another input")
            conditions[part[0]] = part[2]
        rules.append(IfThen(conditions, of_output[0][2], joins=bool(rules)))
    return rules


def _split_words(words: list[str], keyword: str) -> list[list[str]]:
    """The parts of a list of words between a keyword in any case."""
    ends = [index for index, word in enumerate(words) if word.lower() == keyword]
    return [words[start + 1 : end] for start, end in itertools.pairwise([-1, *ends, len(words)])]


def _split_blocks(text: str) -> list[_Block]:
    blocks: list[_Block] = []
    for line, row in enumerate(text.splitlines(), start=1):
        content = row.partition("#")[0].strip()
        if not content:
            continue
        key, colon, value = (part.strip() for part in content.partition(":"))
        if not colon:
            raise ValueError(f"line {line}: {content!r} is not of the form KEY: VALUE")
        if key in BLOCKS:
            if any(block.name == value and block.kind != "Engine" and value for block in blocks):
                raise ValueError(f"line {line}: {value} is declared twice")
            blocks.append(_Block(key, value, line))
        elif not blocks:
            raise ValueError(f"line {line}: {key} comes before any of {', '.join(BLOCKS)}")
        else:
            _check_entry(blocks[-1], line, key, value)
            blocks[-1].entries.append((line, key, value))
    return blocks


def _check_places(blocks: list[_Block]) -> None:
    for block in blocks:
        for line, key, _ in block.entries:
            if key not in KEYS[block.kind]:
                raise ValueError(
                    f"line {line}: {block.kind} has no {key}; valid: {', '.join(sorted(KEYS[block.kind]))}"
                )


def _check_entry(block: _Block, line: int, key: str, value: str) -> None:
    known = set().union(*KEYS.values())
    if key not in known:
        raise ValueError(f"line {line}: {key} is not known; valid: {', '.join(sorted(known))}")
    before = [entry for entry in block.entries if entry[1] == key]
    if before and key not in REPEATED:
        raise ValueError(f"line {line}: {key} is given twice, first in line {before[0][0]}")
    if key == "term" and any(entry[2].split()[:1] == value.split()[:1] for entry in before):
        raise ValueError(f"line {line}: {block.name} has another term of that name: {value}")
    limit = MAX_TERMS if block.kind == "InputVariable" else MAX_RULES
    if len(before) >= limit:
        raise ValueError(f"line {line}: more than {limit} {key}s of {block.kind} {block.name}".rstrip())
    if key == "lock-previous" and value == "true":
        raise ValueError(f"line {line}: lock-previous is true, but hardware keeps no value; give a default instead")
    if key in ("enabled", "lock-range", "lock-previous") and value != ("true" if key == "enabled" else "false"):
        raise ValueError(f"line {line}: {key} is {value}, which is not supported")


def _parse_input(block: _Block) -> Input:
    low, high = _parse_range(block)
    terms = [_parse_at(line, _parse_term, value) for line, value in block.find_all("term")]
    if not terms:
        raise ValueError(f"line {block.line}: {block.name} has no term; add one, or leave the input out")
    return Input(block.name, low, high, {term.name: term for term in terms}, block.line)


def _parse_term(text: str) -> Term:
    words = text.split()
    if len(words) < 2:
        raise ValueError(f"term {text!r} is not of the form: NAME SHAPE NUMBERS")
    name, shape, *parameters = words
    if len(parameters) > MAX_PARAMETERS:
        raise ValueError(f"term {name}: {len(parameters)} numbers; at most {MAX_PARAMETERS} are supported")
    return Term(name, shape, tuple(map(_parse_number, parameters)))


def _parse_output(block: _Block) -> Output:
    defuzzifier = block.get("defuzzifier", "none")
    if defuzzifier not in DEFUZZIFIERS:
        raise ValueError(f"line {block.line}: defuzzifier is {defuzzifier}; WeightedAverage is supported")
    low, high = _parse_range(block)
    constants = dict(_parse_at(line, _parse_constant, value, low, high) for line, value in block.find_all("term"))
    line, default = next(block.find_all("default"), (block.line, "nan"))
    return Output(block.name, low, high, constants, _parse_at(line, _parse_number, default), block.line)


def _parse_constant(text: str, low: float, high: float) -> tuple[str, float]:
    words = text.split()
    # A plane without slopes.
    if words[1:2] == ["Linear"] and not any(map(_parse_number, words[2:-1])):
        words = [words[0], "Constant", *words[-1:]]
    if len(words) != 3 or words[1] != "Constant":
        raise ValueError(f"term {text!r}: an output of order zero has terms of the form NAME Constant NUMBER")
    value = _parse_number(words[2])
    if not low <= value <= high:
        raise ValueError(f"term {words[0]} is {value:g}, outside of the range {low:g} to {high:g}")
    return words[0], value


def _parse_range(block: _Block) -> tuple[float, float]:
    for line, value in block.find_all("range"):
        low, high = _parse_at(line, _parse_two_numbers, value)
        return low, high
    # FuzzyLite's default. The integer model needs finite ranges, which `FuzzySystem` checks.
    return -math.inf, math.inf


def _parse_two_numbers(text: str) -> tuple[float, float]:
    try:
        low, high = map(_parse_number, text.split())
    except ValueError:
        raise ValueError(f"range is {text!r}; give two numbers") from None
    return low, high


def _parse_number(text: str) -> float:
    """Parse a number as FuzzyLite writes it; Python would also read ``6_0``, and digits of other scripts."""
    if "_" in text or not text.isascii():
        raise ValueError(f"{text!r} is not a number")
    return float(text)


def _parse_at(line: int, parse: Callable[..., Result], *arguments: str | float | set[str]) -> Result:
    """Call ``parse``; an error in ``arguments`` is reported with the line number."""
    try:
        return parse(*arguments)
    except ValueError as error:
        raise ValueError(f"line {line}: {error}") from None
