"""Writes a device-tree overlay for Linux without PYNQ: python3 overlay.py skymosaic.hwh > skymosaic.dtso.

It takes the addresses that Vivado assigned from the .hwh file. The overlay binds the registers of the accelerator and
of its DMAs to the driver generic-uio, and memory for a frame and its packets to u-dma-buf.
"""

import argparse
import pathlib
import xml.etree.ElementTree as ET

import skymosaic_map as register_map

BLOCKS = ("skymosaic", "dma_video", *("dma_" + output for output in register_map.PACKET_BYTES))
ROOT_CELLS = {"zynq": 1, "zynquplus": 2}
"""Cells of an address at the root of the board's device tree, by family."""
# Has AMD's kernels set the ports as wide as they are built, 128 bits, whatever another overlay has set: by registers 4
# and 5 for reads and writes through S_AXI_HP0, by 14 for M_AXI_HPM0 and M_AXI_HPM1.
PORTS = """    skymosaic-ports {
        compatible = "xlnx,afi-fpga";
        config-afi = <4 0>, <5 0>, <14 0xa00>;
    };"""


def buffer_sizes():
    """Bytes of each buffer, in whole MiB: what the longest frame and packets of this build need."""
    built = register_map.BUILT
    # With two pixels per clock, a line of odd width has one more.
    frame = 4 * (built["built_width_px"] + 1) * built["built_height_px"]
    sizes = {"frame": min(frame, register_map.MAX_TRANSFER_BYTES), **register_map.PACKET_BYTES}
    return {name: -(-size >> 20) << 20 for name, size in sizes.items()}


def block_ranges(hwh):
    """Find the first address and length of each block's registers in the text of a .hwh file.

    Raises
    ------
    ValueError
        If a block is missing.
    """
    ranges = {}
    for each in ET.fromstring(hwh).iter("MEMRANGE"):
        name = each.get("INSTANCE")
        if name in BLOCKS and each.get("MEMTYPE") == "REGISTER":
            first, last = int(each.get("BASEVALUE"), 16), int(each.get("HIGHVALUE"), 16)
            ranges[name] = first, last + 1 - first
    missing = [name for name in BLOCKS if name not in ranges]
    if missing:
        raise ValueError(f"no registers of {', '.join(missing)}; give the .hwh of the same export")
    return ranges


def overlay(hwh, family):
    """Write the overlay for a board of a family."""
    cells = ROOT_CELLS[family]

    def words(value):
        return " ".join(f"{value >> 32 * n & 0xFFFFFFFF:#x}" for n in reversed(range(cells)))

    # The kernel's driver knows no names by itself: its parameter of_id is set to generic-uio.
    nodes = [
        f'    {name}@{first:x} {{\n        compatible = "generic-uio";\n'
        f'        linux,uio-name = "{name}";\n        reg = <{words(first)} {words(length)}>;\n    }};'
        for name, (first, length) in block_ranges(hwh).items()
    ]
    nodes += [
        f'    udmabuf-{name} {{\n        compatible = "ikwzm,u-dma-buf";\n'
        f'        device-name = "udmabuf-{name}";\n        size = <{size:#x}>;\n    }};'
        for name, size in buffer_sizes().items()
    ]
    nodes += [PORTS] if family == "zynquplus" else []
    # At the root: Linux makes no devices of what a bus holds that is itself new in an overlay.
    head = ["/dts-v1/;\n/plugin/;\n\n&{/} {", f"    #address-cells = <{cells}>;\n    #size-cells = <{cells}>;"]
    return "\n".join([*head, *nodes, "};\n"])


def main():
    """Print the overlay for a .hwh file."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("hwh", type=pathlib.Path, help="from Vivado, beside the bitstream")
    path = parser.parse_args().hwh
    try:
        hwh = path.read_text(encoding="utf-8")
        family = "zynquplus" if "zynq_ultra_ps_e" in hwh else "zynq"
        print(overlay(hwh, family), end="")
    except OSError as error:
        parser.error(f"{path}: {error.strerror}")
    except ET.ParseError as error:
        parser.error(f"{path}: not XML ({error}); give the .hwh file that Vivado wrote")
    except ValueError as error:
        parser.error(f"{path}: {error}")


if __name__ == "__main__":
    main()
