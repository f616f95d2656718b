"""Splits the one huge function that CXXRTL writes: compiling it whole takes minutes and gigabytes, on one core."""

from __future__ import annotations

import re
from collections import Counter, defaultdict
from collections.abc import Iterator
from typing import NamedTuple

UNIT_LINES = 2500
"""Lines of a compilation unit: few enough to compile in seconds, and enough to outweigh the header of each unit."""

# CXXRTL compares each register with its next value and copies it if they differ, to report whether the model has
# settled. We never read that report; plain copies make the simulation twice as fast (measured).
COMMIT = re.compile(r"\t\tif \(((?!memory_)\w+)\.commit\(observer\)\) changed = true;\n")
CLASS_END = "}; // struct p_top\n"
NAMESPACE_END = "} // namespace cxxrtl_design\n"
EVAL = re.compile(r"bool p_top::eval\(performer \*performer\) \{\n(.*?)\n\treturn converged;\n\}\n", re.DOTALL)
LOCAL = re.compile(r"\tvalue<\d+> (\w+);")
OUTLINE = re.compile(r"/\*outline\*/ value<\d+> (\w+);")
"""Members of the class in a model for waves: they have the names and values of the local variables."""
NAME = re.compile(r"\w+")
EDGE = re.compile(r"\tbool \w+ = this->\w+\(\);")
COMMENT = re.compile(r"\t+//.*\n")
NEXT = re.compile(r"(\w+)\.next\b")
LEAST_GROUP = 4
"""Registers with the same enable that are copied under a condition; for fewer, the condition costs more (measured)."""
COMMIT_START = "\t\tbool changed = false;\n"
ENABLED = re.compile(r"\tif \((posedge_\w+)\) \{\n\t\tif \((.+)\) \{\n\t\t\t(\w+\.next\b.*;)\n\t\t\}\n\t\}\n")
"""Assignment of a register's next value if its enable is high. Only the clock edge reads next values."""


class Units(NamedTuple):
    """The files of a CXXRTL model.

    Parameters
    ----------
    header : str
        ``design.hpp``, with the class.
    each_cycle : list of str
        The parts of its evaluation.
    rest : str
        The rest: the reset, the evaluation that calls its parts, and the names for waves.
    """

    header: str
    each_cycle: list[str]
    rest: str


def split(model: str) -> Units:
    """Split a model that CXXRTL wrote.

    Local variables of its evaluation that two parts share become members of the class. The others stay local to their
    part, where the compiler need not store them.
    """
    declaration, definitions = model.split(CLASS_END)
    evaluation = EVAL.search(definitions)
    assert evaluation is not None
    by_enable, groups = _by_enable(COMMENT.sub("", evaluation[1]))
    lines = by_enable.splitlines()
    found = [match for match in map(LOCAL.fullmatch, lines) if match]
    outlines = set(OUTLINE.findall(declaration))
    edges = [line for line in lines if EDGE.fullmatch(line)]
    skipped = {*(match[0] for match in found), *edges, "\tbool converged = false;"}
    bodies = list(_parts(line for line in lines if line not in skipped))
    calls = [f"\teval_{number}();" for number in range(len(bodies))]
    members = [f"\tvoid eval_{number}();" for number in range(len(bodies))]
    names = [set(NAME.findall("\n".join(body))) for body in bodies]
    parts_with = Counter(name for part in names for name in part)
    values = {match[1]: match[0] for match in found if match[1] not in outlines}
    shared = [value for name, value in values.items() if parts_with[name] > 1]
    header = [_committed_by_enable(declaration, groups), *shared, *members, CLASS_END, NAMESPACE_END]
    shell = ["bool p_top::eval(performer *performer) {", *calls, "\treturn false;", "}\n"]
    rest = definitions.replace(evaluation[0], "\n".join(shell))
    local = [[values[name] for name in sorted(part & values.keys()) if parts_with[name] == 1] for part in names]
    return Units(
        header="\n".join(header),
        each_cycle=[_unit(number, [*edges, *local[number], *body]) for number, body in enumerate(bodies)],
        rest=f'#include "design.hpp"\nnamespace cxxrtl_design {{\n{rest}',
    )


def _by_enable(evaluation: str) -> tuple[str, list[set[str]]]:
    """Rewrite the evaluation: one condition at the end for all registers with the same enable, not one for each bit.

    Also returned: the registers of each condition that change nowhere else, if they are at least `LEAST_GROUP`.
    """
    registers: defaultdict[tuple[str, str], list[str]] = defaultdict(list)

    def take(register: re.Match[str]) -> str:
        edge, enable, assignment = register.groups()
        registers[edge, enable].append(assignment)
        return ""

    parts = [ENABLED.sub(take, evaluation + "\n")]
    changes = Counter(NEXT.findall(evaluation))
    groups: list[set[str]] = []
    for (edge, enable), assignments in registers.items():
        group = {name for name in NEXT.findall(" ".join(assignments)) if changes[name] == 1}
        statements = [f"\t\t{assignment}" for assignment in assignments]
        if len(group) >= LEAST_GROUP:
            statements.append(f"\t\tenabled_{len(groups)} = true;")
            groups.append(group)
        parts += [f"\tif ({edge} && ({enable})) {{", *statements, "\t}"]
    return "\n".join(parts), groups


def _committed_by_enable(declaration: str, groups: list[set[str]]) -> str:
    """Copy the next values of registers, those of a group only after a clock in which its enable was high."""
    group_of = {name: number for number, group in enumerate(groups) for name in group}
    copies: defaultdict[int, list[str]] = defaultdict(list)

    def take(commit: re.Match[str]) -> str:
        name = commit[1]
        copy = f"\t\t{name}.curr = {name}.next;\n"
        if name not in group_of:
            return copy
        copies[group_of[name]].append(copy)
        return ""

    others = COMMIT.sub(take, declaration)
    start = others.index(COMMIT_START) + len(COMMIT_START)
    conditions = [
        f"\t\tif (enabled_{number}) {{\n\t\tenabled_{number} = false;\n{''.join(lines)}\t\t}}\n"
        for number, lines in copies.items()
    ]
    flags = [f"\tbool enabled_{number} = false;\n" for number in range(len(groups))]
    return "".join([others[:start], *conditions, others[start:], *flags])


def _parts(lines: Iterator[str]) -> Iterator[list[str]]:
    """Split into parts of about `UNIT_LINES` lines, between statements."""
    part: list[str] = []
    depth = 0
    for line in lines:
        part.append(line)
        depth += line.count("{") - line.count("}")
        if len(part) >= UNIT_LINES and not depth and line.endswith((";", "}")):
            yield part
            part = []
    yield part


def _unit(number: int, lines: list[str]) -> str:
    head = f'#include "design.hpp"\nnamespace cxxrtl_design {{\nvoid p_top::eval_{number}() {{\n'
    return head + "\n".join(lines) + "\n}\n" + NAMESPACE_END
