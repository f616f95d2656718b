# amaranth: UnusedElaboratable=no
# Blocks that are refused are never elaborated, of which whoever reads the refusal would be warned, too.
"""Blocks of one's own: a class, and a function that is its golden model."""

import importlib
import inspect
from dataclasses import replace
from random import Random
from typing import Any

from amaranth import Shape
from amaranth.lib import wiring
from amaranth.lib.wiring import In

from hdl.blocks.flat import CLOCK, RESET, FlatBlock
from hdl.blocks.vectors import LICENCE, Block, Row

LINE, LINES = 30, 26
"""Records of a line, and lines of the frame that a model gets."""


def make_own(path: str, model: str | None) -> Block:
    """Make a block of ``MODULE:CLASS``, a component, or of a function that returns a `Block`, without arguments.

    Parameters
    ----------
    path : str
    model : str, optional
        ``MODULE:FUNCTION``. For each stream or beat that goes in, it gets records, dictionaries by the names of the
        ports; for those that come out, it returns them in a dictionary, without what is not to be compared. Its
        defaults are the values of other inputs. Records are random, but x, y and last scan a frame of 30x26. Without a
        model, there are no vectors.

    Raises
    ------
    ValueError
        For a module, class or function that cannot be used, or answers that are not the component's.
    """
    try:
        made = _load(path)()
    # Whatever the user's module raises.
    except Exception as error:
        raise ValueError(f"{path}: {' '.join(str(error).split())}; give MODULE:CLASS that takes no arguments") from None
    if isinstance(made, wiring.Component):
        licence = LICENCE if path.startswith("hdl.") else ""
        block = Block(made, (type(made).__doc__ or "").partition("\n")[0], {}, {}, licence=licence)
        return _add_vectors(block, model) if model else block
    if not isinstance(made, Block) or model:
        wanted = "no component" if model else "no component and no block with vectors"
        raise ValueError(f"{path}: makes a {type(made).__name__}, {wanted}")
    return made


def _add_vectors(block: Block, path: str) -> Block:
    ports = FlatBlock(block.component).signature.members
    held = {name: 0 for name, member in ports.items() if member.flow == In and name not in (CLOCK, RESET)}
    streams: dict[str, list[str]] = {}
    for stream in (name.removesuffix("_valid") for name in ports if name.endswith("_valid")):
        of_stream = [name for name in ports if f"{name}_".startswith(f"{stream}_")]
        streams[stream] = [name for name in of_stream if name not in (f"{stream}_valid", f"{stream}_ready")]
        held = {name: value for name, value in held.items() if name not in of_stream}
    inputs = [stream for stream in streams if ports[f"{stream}_valid"].flow == In]
    outputs = [stream for stream in streams if stream not in inputs]
    random = Random(1)

    def record(names: list[str], number: int) -> Row:
        return {name: _sample(name, Shape.cast(ports[name].shape), number, random) for name in names}

    sent = {name: [record(streams[name], number) for number in range(LINE * LINES)] for name in inputs}
    try:
        model = _load(path)
        parameters = inspect.signature(model).parameters.items()
        held |= {name: each.default for name, each in parameters if each.default is not each.empty}
        found = model(**{name: [dict(row) for row in rows] for name, rows in sent.items()})
        answers = {name: [{port: int(row[port]) for port in row} for row in found[name]] for name in outputs}
    except Exception as error:
        remedy = f"return a dictionary with a list of records for {' and for '.join(outputs) or 'no stream'}"
        raise ValueError(f"{path}: {' '.join(str(error).split())}; {remedy}") from None
    for name, rows in answers.items():
        if not rows or any(row.keys() - streams[name] for row in rows):
            raise ValueError(f"{path}: answer {name} with records of {', '.join(streams[name])}, at least one")
    spacing_cycles = getattr(block.component, "spacing_cycles", 1)
    return replace(block, inputs=sent, outputs=answers, settings=held, spacing_cycles=spacing_cycles)


def _sample(port: str, shape: Shape, number: int, random: Random) -> int:
    """A random value of a port, or that of a scan in which the record has this number."""
    y, x = divmod(number, LINE)
    scanned = {"x": x, "y": y, "last": x == LINE - 1}
    raw = scanned.get(port.rpartition("_")[2], random.getrandbits(shape.width)) & (1 << shape.width) - 1
    return raw - (1 << shape.width) if shape.signed and raw >> shape.width - 1 else raw


def _load(path: str) -> Any:
    module, _, name = path.partition(":")
    return getattr(importlib.import_module(module), name)
