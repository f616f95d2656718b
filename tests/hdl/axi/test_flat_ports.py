"""The buses of AXI have its signals; ports of tops are recorded in `test_accelerator`, and used by `tests/cocotb`."""

import pytest
from amaranth.lib.wiring import In, Out

from hdl.axi.axi_lite import AXI_LITE
from hdl.axi.axi_read import AXI_READ
from hdl.axi.axi_write import AXI_WRITE

_BURST = "addr:64 len:8 size:3 burst:2 cache:4 prot:3 valid ready<"
_LITE, _ANSWER = "addr:12 prot:3 valid ready<", "resp:2< valid< ready"
BUSES = {
    "lite": (AXI_LITE, (_LITE, "data:32 strb:4 valid ready<", _ANSWER, _LITE, "data:32< resp:2< valid< ready")),
    "write": (AXI_WRITE, (_BURST, "data:64 strb:8 last valid ready<", _ANSWER, "", "")),
    "read": (AXI_READ, ("", "", "", _BURST, "data:64< resp:2< last< valid< ready")),
}
"""Signals with their widths, in the channels aw, w, b, ar and r; `<`: towards the manager."""


@pytest.mark.parametrize("bus", BUSES)
def test_the_channels_of_a_bus_have_the_signals_of_axi(bus: str) -> None:
    signature, channels = BUSES[bus]
    expected = {}
    for channel, signals in zip(("aw", "w", "b", "ar", "r"), channels, strict=True):
        for name, _, bits in (each.rstrip("<").partition(":") for each in signals.split()):
            flow = In if {f"{name}<", f"{name}:{bits}<"} & {*signals.split()} else Out
            expected[f"{channel}{name}"] = flow(int(bits or 1))
    assert dict(signature.members.items()) == expected
