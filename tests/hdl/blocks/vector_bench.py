"""Runs the vectors of a block that cannot stall in Amaranth's simulator."""

from typing import Any

from amaranth.hdl import Value

from hdl.blocks.flat import leaves
from hdl.blocks.vectors import Block, Row
from tests.hdl.drivers import run_clocks

FLUSH_CYCLES = 64


def pack(name: str, shape: Any, row: Row) -> int:
    """The bits of a port with the values of a row; fields that the row lacks are 0."""
    word = 0
    for field, low, own in leaves(name, shape):
        word |= (row.get(field, 0) & (1 << own.width) - 1) << low
    return word


def unpack(name: str, shape: Any, word: int) -> Row:
    """The fields of a port's bits, as unsigned numbers."""
    return {field: word >> low & (1 << own.width) - 1 for field, low, own in leaves(name, shape)}


def run_vectors(block: Block) -> list[Row]:
    """What the block answers to its inputs: the beats at ``o`` that are valid, in order."""
    dut: Any = block.component
    shapes = {name: dut.signature.members[name].shape for name in ("i", "o")}
    sent, answer = Value.cast(dut.i), Value.cast(dut.o)
    clocks: list[list[Any]] = [[(getattr(dut, name), value) for name, value in block.settings.items()]]
    for row in block.inputs["i"]:
        clocks.append([(sent, pack("i", shapes["i"], {**row, "i_valid": 1}))])
        clocks += [[(sent, 0)]] * (block.spacing_cycles - 1)
    found = run_clocks(dut, [*clocks, *[[(sent, 0)]] * FLUSH_CYCLES], [answer])
    rows = (unpack("o", shapes["o"], word) for (word,) in found)
    return [row for row in rows if row["o_valid"]]


def compare(block: Block) -> None:
    """The block answers what its vectors expect, where they say so, and nothing else."""
    dut: Any = block.component
    ones = {name: (1 << shape.width) - 1 for name, _, shape in leaves("o", dut.signature.members["o"].shape)}
    found, expected = run_vectors(block), block.outputs["o"]
    assert len(found) == len(expected)
    for number, (answer, row) in enumerate(zip(found, expected, strict=True)):
        assert {name: answer[name] for name in row} == {name: row[name] & ones[name] for name in row}, number
