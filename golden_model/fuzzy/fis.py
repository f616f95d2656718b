"""Translates ``.fis``, the files of MATLAB's Fuzzy Logic Toolbox, into FLL."""

import re
from collections.abc import Iterator

SHAPES = {
    "trimf": ("Triangle", "012"), "trapmf": ("Trapezoid", "0123"), "linsmf": ("Ramp", "01"), "linzmf": ("Ramp", "10"),
    "smf": ("SShape", "01"), "zmf": ("ZShape", "01"), "pimf": ("PiShape", "0123"), "gaussmf": ("Gaussian", "10"),
    "gauss2mf": ("GaussianProduct", "1032"), "gbellmf": ("Bell", "201"), "sigmf": ("Sigmoid", "10"),
    "dsigmf": ("SigmoidDifference", "1023"), "psigmf": ("SigmoidProduct", "1023"), "constant": ("Constant", "0"),
    "linear": ("Linear", ""),
}  # fmt: skip
"""FLL's name of each shape, and which numbers of ``.fis`` are its parameters, in order."""
METHODS = {"min": "Minimum", "prod": "AlgebraicProduct", "max": "Maximum"}
SUPPORTED = {"Type": "sugeno", "DefuzzMethod": "wtaver"}
KINDS = {"[System": "Engine", "[Input": "InputVariable", "[Output": "OutputVariable"}
_KEY = re.compile(r"Name|Type|Version|Range|Num\w+|(And|Or|Imp|Agg|Defuzz)Method|MF[1-9]\d*")
_TERM = re.compile(r"'([^']*)'\s*:\s*'(\w+)'\s*,\s*\[([^\]]*)\]")
_RULE = re.compile(r"([-\d.\s]+),([-\d.\s]+)\((\d*\.?\d+)\)\s*:\s*([12])")
Sections = dict[str, dict[str, str]]
"""By heading, the value of each key; of an MF its name, of rules what they are in FLL."""


def to_fll(text: str) -> str:
    """Translate line for line, so that what is said of a line of the result holds for that of ``text``.

    Names become identifiers. ``ImpMethod`` and ``AggMethod`` mean nothing in a Sugeno system.

    Raises
    ------
    ValueError
        For text that is malformed or cut off, and for what no Sugeno system with constants has.
    """
    heading, sections, lines = "", Sections({"[System]": {}}), list[str]()
    for line, row in enumerate(map(str.strip, text.splitlines()), start=1):
        if row.startswith("["):
            heading = row
            sections[heading] = {}
            lines.append("RuleBlock:" if row == "[Rules]" else "")
            continue
        try:
            lines.append(_translate(row, heading, sections) if row and row[0] not in "%#" else "")
        except ValueError as error:
            raise ValueError(f"line {line}: {error}") from None
    system = sections["[System]"]
    counts = {f"Num{each}s": sum(name.startswith(f"[{each}") for name in sections) for each in ("Input", "Output")}
    for key, value in {**SUPPORTED, **counts, "NumRules": len(sections.get("[Rules]", ()))}.items():
        if (given := system.get(key, "missing")).lower() != str(value):
            why = "is supported" if key in SUPPORTED else "are there; is the file cut off?"
            raise ValueError(f"{key} is {given}; {value} {why}")
    methods = [METHODS.get(name, name) for name in (system.get("AndMethod", "none"), system.get("OrMethod", "none"))]
    return "\n".join([*lines, "  conjunction: {}\n  disjunction: {}\n  activation: General\n".format(*methods)])


def _translate(row: str, heading: str, sections: Sections) -> str:
    if heading == "[Rules]":
        return sections[heading].setdefault(str(len(sections[heading])), _translate_rule(row, sections))
    key, _, value = (part.strip() for part in row.partition("="))
    kind = KINDS.get(heading.rstrip("0123456789]"))
    if kind is None or not _KEY.fullmatch(key):
        raise ValueError(f"{row!r} is not known in a .fis file")
    bare = value.strip("'[]")
    if bare.lower() != SUPPORTED.get(key, bare.lower()):
        raise ValueError(f"{key} is {bare}; {SUPPORTED[key]} is supported")
    sections[heading][key] = bare
    if key == "Name":
        sections[heading][key] = _identifier(bare)
        return f"{kind}: {sections[heading][key]}"
    if key == "Range":
        return f"  range: {bare.replace(',', ' ')}"
    if not key.startswith("MF"):
        return "  defuzzifier: WeightedAverage" if (kind, key) == ("OutputVariable", "NumMFs") else ""
    found = _TERM.fullmatch(value)
    if not found or found[2] not in SHAPES:
        raise ValueError(f"{value} is not of the form 'NAME':'SHAPE',[NUMBERS] with a shape of {', '.join(SHAPES)}")
    sections[heading][key] = name = _identifier(found[1])
    (shape, order), numbers = SHAPES[found[2]], found[3].replace(",", " ").split()
    # Old files fill up with zeros. Where there are too many or too few, the shape says so.
    fits = order and len(order) <= len(numbers) and not any(map(float, numbers[len(order) :]))
    ordered = [numbers[int(index)] for index in order] if fits else numbers
    return f"  term: {name} {shape} {' '.join(ordered)}"


def _translate_rule(row: str, sections: Sections) -> str:
    found = _RULE.fullmatch(row)
    if not found:
        raise ValueError(f"{row!r} is not a rule of the form 1 2, 3 (1) : 1")
    if float(found[3]) != 1:
        raise ValueError(f"rule {row!r} has a weight of {found[3]}; 1 is supported")
    conditions = (" or " if found[4] == "2" else " and ").join(_name_terms("Input", found[1], sections))
    return f"  rule: if {conditions} then {' and '.join(_name_terms('Output', found[2], sections))}"


def _name_terms(kind: str, text: str, sections: Sections) -> Iterator[str]:
    numbers, variables = text.split(), [each for name, each in sections.items() if name.startswith(f"[{kind}")]
    if len(numbers) != len(variables):
        raise ValueError(f"a rule has {len(numbers)} numbers for {len(variables)} {kind.lower()}s")
    for number, variable in zip(map(float, numbers), variables, strict=True):
        if number < 0 or number % 1:
            raise ValueError(f"{number:g} is a term with NOT or a hedge; terms stand alone here")
        if number:
            if f"MF{number:g}" not in variable:
                raise ValueError(f"{variable.get('Name', kind)} has no MF{number:g}")
            yield f"{variable['Name']} is {variable[f'MF{number:g}']}"


def _identifier(name: str) -> str:
    return re.sub(r"\W", "_", name)
