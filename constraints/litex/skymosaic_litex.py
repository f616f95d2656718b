"""The accelerator as a LiteX module: an instance of the Verilog, its registers on the SoC's bus.

    from skymosaic_litex import Skymosaic

    self.skymosaic = Skymosaic(platform)
    self.bus.add_slave("skymosaic", self.skymosaic.bus, SoCRegion(size=Skymosaic.REGISTERS_BYTES, cached=False))
    self.comb += [source.connect(self.skymosaic.video), self.skymosaic.features.connect(sink)]

The registers are described in ``registers/register_map.md``. LiteX translates between the SoC's bus and AXI4-Lite.
"""

from pathlib import Path

from litex.gen import LiteXModule
from litex.soc.interconnect import stream
from litex.soc.interconnect.axi import AXILiteInterface
from migen import ClockSignal, Constant, Instance, ResetSignal, Signal, log2_int

SOURCE = Path(__file__).resolve().parents[1] / "rtl" / "skymosaic.v"


class Skymosaic(LiteXModule):
    """The accelerator in the clock domain ``sys``.

    Attributes
    ----------
    bus : AXILiteInterface
        Registers.
    video : stream.Endpoint
        AXI4-Stream video: ``data``, ``user`` at the start of a frame, ``last`` at the end of a line.
    features, matches, homographies : stream.Endpoint
        Packets of 64-bit words; the last one only where the accelerator estimates homographies.
    interrupt : Signal
        Active high, level.
    """

    VIDEO_BITS = 0
    OUTPUTS = ()
    REGISTERS_BYTES = 4096

    def __init__(self, platform):
        self.bus = bus = AXILiteInterface(data_width=32, address_width=32, addressing="byte")
        self.video = stream.Endpoint([("data", self.VIDEO_BITS), ("user", 1)])
        self.interrupt = Signal()
        ports = {
            "i_aclk": ClockSignal(),
            "i_aresetn": ~ResetSignal(),
            # LiteX's buses have these signals, too, but nothing drives them.
            "i_s_axi_ctrl_awprot": Constant(0, 3),
            "i_s_axi_ctrl_arprot": Constant(0, 3),
            "o_interrupt": self.interrupt,
        }
        streams = [("i", "o", "s_axis_video", self.video, "user")]
        for name in self.OUTPUTS:
            setattr(self, name, stream.Endpoint([("data", 64), ("keep", 8)]))
            streams.append(("o", "i", f"m_axis_{name}", getattr(self, name), "keep"))
        for way, back, port, endpoint, beside in streams:
            ports |= {f"{way}_{port}_t{name}": getattr(endpoint, name) for name in ("data", beside, "last", "valid")}
            ports[f"{back}_{port}_tready"] = endpoint.ready
        inputs = {"aw": ("addr", "valid"), "w": ("data", "strb", "valid"), "b": ("ready",)}
        inputs |= {"ar": ("addr", "valid"), "r": ("ready",)}
        outputs = {"aw": ("ready",), "w": ("ready",), "b": ("resp", "valid"), "ar": ("ready",)}
        outputs |= {"r": ("data", "resp", "valid")}
        for way, channels in (("i", inputs), ("o", outputs)):
            for channel, names in channels.items():
                for name in names:
                    value = getattr(getattr(bus, channel), name)
                    # The bus has the whole address, the core that of a byte in its registers.
                    value = value[: log2_int(self.REGISTERS_BYTES)] if name == "addr" else value
                    ports[f"{way}_s_axi_ctrl_{channel}{name}"] = value
        self.specials += Instance("skymosaic", **ports)
        platform.add_source(str(SOURCE))
