"""Turns a user-defined fuzzy system into a Verilog block; unlike the rest of this folder, it imports Amaranth."""

import re
from dataclasses import replace

from golden_model.fuzzy.system import FuzzySystem
from hdl.blocks.catalogue import sugeno
from hdl.blocks.vectors import Block
from hdl.fuzzy.sugeno import PRODUCT_INPUTS
from skymosaic.fuzzy.quantised import QuantisedSystem

MAX_ENTRIES = 4096
"""Entries per table; each table is a memory of 9 bits per term and entry."""
VECTORS = 400
TAKEN = ("valid", "ready", "rule", "rows", "next", "wait", "specified", "taken")


def make_block(quantised: QuantisedSystem) -> Block:
    """Make a block for `hdl.blocks.export.write_block` that computes exactly what ``quantised.model`` computes.

    Its inputs are the indices of the tables, its outputs are the weight in 256ths of the output's range and the
    dominant rule. A result takes one clock per rule and about 15 more.

    Raises
    ------
    ValueError
        For tables of more than `MAX_ENTRIES`, or AND as product of more than 3 inputs.
    """
    if quantised.entries > MAX_ENTRIES:
        raise ValueError(f"entries is {quantised.entries}; hardware takes at most {MAX_ENTRIES}")
    inputs = len(quantised.model.inputs)
    # Checked before the block is made: Amaranth warns about a component that is made and then not used.
    if quantised.model.conjunction == "product" and inputs not in PRODUCT_INPUTS:
        raise ValueError(f"AND as product of {inputs} inputs; hardware multiplies at most {max(PRODUCT_INPUTS)}")
    names = _name_ports(quantised.real)
    description = _describe(quantised, names)
    block = sugeno(quantised.model, (quantised.entries - 1).bit_length(), description, vectors=VECTORS)
    return replace(block, names=names)


def identifier(name: str) -> str:
    """A name with underscores in place of what a name in Verilog cannot hold."""
    return re.sub(r"\W", "_", name, flags=re.ASCII)


def _name_ports(system: FuzzySystem) -> dict[str, str]:
    """Ports by the names of their variables; one that stream or test bench use, too, gets underscores."""
    names: dict[str, str] = {}
    variables = {f"i_{number}": each.name for number, each in enumerate(system.inputs)}
    for port, variable in {**variables, "o_weight": system.output.name}.items():
        name = f"{port[:2]}{identifier(variable)}"
        while name in names.values() or name[2:] in TAKEN:
            name += "_"
        names[port] = name
    return names


def _describe(quantised: QuantisedSystem, names: dict[str, str]) -> str:
    system, last = quantised.real, quantised.entries - 1
    output = system.output
    inputs = "; ".join(
        f"`{names[f'i_{number}']}` is {variable.name}, 0 for {variable.low:g} and {last} for {variable.high:g}"
        for number, variable in enumerate(system.inputs)
    )
    return (
        f"The zero-order Sugeno system {system.name} with {len(system.rules)} rules, AND is the {system.conjunction}. "
        f"Each input is an index, in equal steps: {inputs}. `{names['o_weight']}` is {output.name}, 0 for "
        f"{output.low:g} and 256, limited to 255, for {output.high:g}; 0 too where no rule fires. `o_rule` is the "
        "strongest rule, from 0."
    )
