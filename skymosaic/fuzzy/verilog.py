"""Turns a user-defined fuzzy system into a Verilog block; unlike the rest of this folder, it imports Amaranth."""

from hdl.blocks.catalogue import sugeno
from hdl.blocks.vectors import Block
from hdl.fuzzy.sugeno import PRODUCT_INPUTS
from skymosaic.fuzzy.quantised import QuantisedSystem

MAX_ENTRIES = 4096
"""Entries per table; each table is a memory of 9 bits per term and entry."""
VECTORS = 400


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
    return sugeno(quantised.model, (quantised.entries - 1).bit_length(), _describe(quantised), vectors=VECTORS)


def _describe(quantised: QuantisedSystem) -> str:
    system, last = quantised.real, quantised.entries - 1
    output = system.output
    inputs = "; ".join(
        f"`i_{number}` is {variable.name}, 0 for {variable.low:g} and {last} for {variable.high:g}"
        for number, variable in enumerate(system.inputs)
    )
    return (
        f"The zero-order Sugeno system {system.name} with {len(system.rules)} rules, AND is the {system.conjunction}. "
        f"Each input is an index, in equal steps: {inputs}. `o_weight` is {output.name}, 0 for {output.low:g} and 256, "
        f"limited to 255, for {output.high:g}; 0 too where no rule fires. `o_rule` is the strongest rule, from 0."
    )
