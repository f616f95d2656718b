"""Names from the source for ports that Amaranth numbers.

A signal that is used in another module gets a port in every module on the way. Where a module has no signal of exactly
these bits, Amaranth calls its port ``port$8056$0``.
"""

import contextlib
from collections.abc import Iterator
from typing import Any

import amaranth.hdl._ir

_IR: Any = amaranth.hdl._ir
_NUMBERED = "port$"


@contextlib.contextmanager
def name_ports() -> Iterator[None]:
    """Call such ports after the signals that they carry, while a design is converted."""
    # Amaranth has no option for it, so the step that names ports is replaced for the time of a conversion.
    compute_ports = _IR._compute_ports

    def compute_and_name(netlist: Any) -> None:
        compute_ports(netlist)
        names = _find_names(netlist)
        for module in netlist.modules:
            _rename(netlist, module, names)

    _IR._compute_ports = compute_and_name
    try:
        yield
    finally:
        _IR._compute_ports = compute_ports


def _find_names(netlist: Any) -> dict[Any, tuple[int, str]]:
    """For each net, a signal that has it, and the bit at which it has it: the lowest one that any signal has."""
    names: dict[Any, tuple[int, str]] = {}
    for module in netlist.modules:
        for signal, name in module.signal_names.items():
            if "$" not in name:
                for bit, net in enumerate(netlist.signals[signal]):
                    if net not in names or bit < names[net][0]:
                        names[net] = bit, name
    return names


def _rename(netlist: Any, module: Any, names: dict[Any, tuple[int, str]]) -> None:
    taken = {*module.signal_names.values(), *module.ports, *module.io_ports}
    taken |= {netlist.modules[index].name[-1] for index in module.submodules}
    taken |= {str(getattr(netlist.cells[index], "name", "")) for index in module.cells}
    ports = dict(module.ports)
    module.ports.clear()
    for old, (value, flow) in ports.items():
        new = old
        if old.startswith(_NUMBERED) and value[0] in names:
            bit, name = names[value[0]]
            new = f"{name}_{bit}" if bit else name
            while new in taken:
                new += "_"
            taken.add(new)
        module.ports[new] = value, flow
