"""A component with a plain port for each field of its streams, beats and arrays."""

from collections.abc import Iterable, Iterator, Mapping
from typing import Any

from amaranth import ClockDomain, ClockSignal, Module, ResetSignal, Shape, ShapeLike, Value
from amaranth.lib import data, wiring
from amaranth.lib.wiring import In

from hdl.axi.flat_ports import FlatTop

CLOCK, RESET = "clk", "rst"
PAYLOAD = "payload"
"""The part of a stream that is left out of the names of its fields."""


def leaves(name: str, shape: ShapeLike, low: int = 0) -> Iterator[tuple[str, int, Shape]]:
    """Walk the leaves of a shape: the name of each, its lowest bit, and its own shape.

    A field ``b`` of a structure ``a`` is ``a_b``, an element of an array ``a_0``.
    """
    # A shape that is no layout is a leaf.
    try:
        layout = data.Layout.cast(shape)
    except TypeError:
        # Verilog has no port without bits.
        if Shape.cast(shape).width:
            yield name, low, Shape.cast(shape)
        return
    for key, field in layout:
        yield from leaves(f"{name}_{key}", field.shape, low + field.offset)


def flat_values(name: str, value: Any) -> dict[str, int]:
    """Flatten a value of dictionaries and sequences, with the names of `leaves`."""
    parts: Iterable[tuple[Any, Any]]
    if isinstance(value, dict):
        parts = value.items()
    elif isinstance(value, list | tuple):
        parts = enumerate(value)
    else:
        return {name: int(value)}
    return {leaf: number for key, part in parts for leaf, number in flat_values(f"{name}_{key}", part).items()}


class FlatBlock(FlatTop):
    """A component in the domain ``sync`` with flat ports, for use outside Amaranth.

    Members
    -------
    clk, rst : In(1)
        Clock, and synchronous reset, active high.
    others
        The `leaves` of the component's members; a stream ``i`` has ``i_valid``, ``i_ready`` and its fields. What
        ``names`` holds is called otherwise.
    """

    def __init__(self, component: wiring.Component, names: Mapping[str, str] | None = None) -> None:
        self.component = component
        pins: dict[str, tuple[wiring.Member, Value]] = {CLOCK: (In(1), ClockSignal()), RESET: (In(1), ResetSignal())}
        for path, member, value in component.signature.flatten(component):
            bits = Value.cast(value)
            for name, low, shape in leaves("_".join(str(part) for part in path if part != PAYLOAD), member.shape):
                port = (names or {}).get(name, name)
                if port in pins:
                    raise ValueError(f"two ports would be called {port}; rename a member of the component")
                pins[port] = member.flow(shape), bits[low : low + shape.width]
        super().__init__(pins)

    def elaborate(self, platform: object) -> Module:
        """Connect each port to its bits of the component's ports."""
        m = Module()
        m.domains.sync = ClockDomain()
        m.submodules.block = self.component
        self.connect_pins(m)
        return m
