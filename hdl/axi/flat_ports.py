"""Tops with plain ports for use outside Amaranth; those of AXI buses are named as AMD names them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from amaranth import Const, Module, Signal, Value
from amaranth.lib import stream, wiring
from amaranth.lib.wiring import Flow, In, Out

from golden_model.records import WORD_BYTES

Pins = Mapping[str, tuple[wiring.Member, Value]]
"""For each port its direction and shape, and the value inside that it is connected to."""


class FlatTop(wiring.Component):
    """A component whose ports are plain signals, each connected to a value inside."""

    if TYPE_CHECKING:
        # The pins make the ports; a type checker cannot know their names.
        def __getattr__(self, name: str) -> Signal: ...

    def __init__(self, pins: Pins) -> None:
        self._pins = pins
        super().__init__({name: member for name, (member, _) in pins.items()})

    def connect_pins(self, m: Module) -> None:
        """Connect each port to its value."""
        for name, (member, value) in self._pins.items():
            port = getattr(self, name)
            m.d.comb += value.eq(port) if member.flow == In else port.eq(value)


def stream_pins(prefix: str, interface: stream.Interface, flow: Flow, **signals: Value) -> Pins:
    """Pins of an AXI4-Stream: TLAST, TVALID, TREADY, and the given signals in the direction of the data."""
    signals |= {"tlast": interface.payload.last, "tvalid": interface.valid}
    pins = {f"{prefix}_{name}": (flow(value.shape()), value) for name, value in signals.items()}
    return pins | {f"{prefix}_tready": (flow.flip()(1), interface.ready)}


def packet_pins(prefix: str, packets: stream.Interface) -> Pins:
    """Pins of an output of packets."""
    # Records are whole words, so that all bytes are kept.
    return stream_pins(prefix, packets, Out, tdata=packets.payload.data, tkeep=Const((1 << WORD_BYTES) - 1))


def bus_pins(prefix: str, bus: Any) -> Pins:
    """Pins of AXI4 or AXI4-Lite, for all members of the interface ``bus``."""
    return {f"{prefix}_{name}": (member, getattr(bus, name)) for name, member in bus.signature.members.items()}
