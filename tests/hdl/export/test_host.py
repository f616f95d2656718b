"""The host's programs of an export: which there are, what they know of the build, and the Linux overlay."""

import dataclasses
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from golden_model.config import EstimatorConfig
from golden_model.records import HOMOGRAPHY, MATCH
from hdl.build import BUILDS, Build
from hdl.export.host import write_host
from hdl.registers.register_map import REGISTERS
from sim.benches.exported import host_programs

TINY = BUILDS["tiny"]
WITH_ESTIMATOR = dataclasses.replace(TINY, config=dataclasses.replace(TINY.config, estimator=EstimatorConfig()))
CAMERA = dataclasses.replace(WITH_ESTIMATOR, video_bits=24, shell="camera")


def test_the_map_has_fields_and_records_of_the_build() -> None:
    with host_programs(TINY) as load:
        found = load("skymosaic_map")
    assert {(name, *found.FIELDS[name]) for name in found.FIELDS} == {
        (field.name, register.offset, field.low, field.bits) for register in REGISTERS for field in register.fields
    }
    assert MATCH.dtype == found.MATCH
    assert found.BUILT["built_lanes"] == TINY.lanes
    # Patch versions are alike for the driver.
    assert {"version_major", "version_minor"} <= found.BUILT.keys()
    assert "version_patch" not in found.BUILT
    # The smallest and largest value that each setting may have.
    assert all(low <= high for low, high in found.WRITABLE.values())
    assert found.WRITABLE["width_px"] == (64, 4096)
    assert found.WRITABLE["clear"] == (0, 1)
    # 64 features or matches, and the two records that end a packet that is broken off.
    assert found.PACKET_BYTES == {"features": 66 * 32, "matches": 66 * 24}


@pytest.mark.parametrize(
    ("build", "homographies", "rings"), [(TINY, False, False), (WITH_ESTIMATOR, True, False), (CAMERA, True, True)]
)
def test_the_map_names_what_the_build_has(build: Build, homographies: bool, rings: bool) -> None:
    with host_programs(build) as load:
        found = load("skymosaic_map")
    assert hasattr(found, "HOMOGRAPHY") == hasattr(found, "HOMOGRAPHY_TAG") == homographies
    assert hasattr(found, "HEADER") == hasattr(found, "PAGE_BYTES") == rings
    if rings:
        assert (found.PAGE_BYTES, found.HEADER_BYTES, found.HEADER.itemsize) == (4096, 128, 40)
        assert (found.UNIT_PX, found.MAX_ELEMENT) == (4096, 2**24 - 1)
    if homographies:
        assert found.PACKET_BYTES["homographies"] == 64
        assert HOMOGRAPHY.dtype == found.HOMOGRAPHY
        assert np.zeros(2, found.HOMOGRAPHY).nbytes == 2 * HOMOGRAPHY.record_bytes


HWH = """<EDKSYSTEM><MODULES><MODULE MODTYPE="{ps}"><MEMORYMAP>
<MEMRANGE INSTANCE="skymosaic" MEMTYPE="REGISTER" BASEVALUE="{base}43C00000" HIGHVALUE="{base}43C0FFFF"/>
<MEMRANGE INSTANCE="dma_video" MEMTYPE="REGISTER" BASEVALUE="0x40400000" HIGHVALUE="0x4040FFFF"/>
<MEMRANGE INSTANCE="dma_features" MEMTYPE="REGISTER" BASEVALUE="0x40410000" HIGHVALUE="0x4041FFFF"/>
<MEMRANGE INSTANCE="dma_matches" MEMTYPE="REGISTER" BASEVALUE="0x40420000" HIGHVALUE="0x4042FFFF"/>
<MEMRANGE INSTANCE="ps" MEMTYPE="MEMORY" BASEVALUE="0x00000000" HIGHVALUE="0x1FFFFFFF"/>
</MEMORYMAP></MODULE></MODULES></EDKSYSTEM>"""


def device_tree(source: Path, *base: Path) -> str:
    """A device tree, compiled without a warning, laid over a base if there is one, and written out again."""
    compiled = str(source.with_suffix(".dtb"))
    compile_it = ["dtc", "-@", "-I", "dts", "-O", "dtb", "-o", compiled, str(source)]
    assert not subprocess.run(compile_it, capture_output=True, text=True, check=True).stderr
    for each in base:
        subprocess.run(["fdtoverlay", "-i", str(each.with_suffix(".dtb")), "-o", compiled, compiled], check=True)
    show = ["dtc", "-I", "dtb", "-O", "dts", compiled]
    return subprocess.run(show, capture_output=True, text=True, check=True).stdout


@pytest.mark.needs("dtc")
@pytest.mark.parametrize(
    ("hwh", "cells", "reg"),
    [
        (HWH.format(ps="processing_system7", base="0x"), 1, "<0x43c00000 0x10000>"),
        (HWH.format(ps="zynq_ultra_ps_e", base="0x4"), 2, "<0x04 0x43c00000 0x00 0x10000>"),
    ],
)
def test_the_overlay_has_the_addresses_of_the_block_design(tmp_path: Path, hwh: str, cells: int, reg: str) -> None:
    """Linux makes devices only of nodes at the root and on buses that were there before."""
    (tmp_path / "skymosaic.hwh").write_text(hwh)
    write_host(tmp_path, Build(max_width_px=4096, max_height_px=4096))
    command = [sys.executable, str(tmp_path / "overlay.py"), str(tmp_path / "skymosaic.hwh")]
    source, base = tmp_path / "skymosaic.dts", tmp_path / "board.dts"
    source.write_text(subprocess.run(command, capture_output=True, text=True, check=True).stdout)
    base.write_text(f"/dts-v1/;\n/ {{ #address-cells = <{cells}>; #size-cells = <{cells}>; }};\n")
    device_tree(base)
    nodes = dict(re.findall(r"^\t(\S+) \{\n(.*?)^\t\};", device_tree(source, base), re.M | re.S))
    assert f"reg = {reg};" in nodes[f"skymosaic@{'4' * (cells == 2)}43c00000"]
    registers = {name.partition("@")[0] for name, node in nodes.items() if 'compatible = "generic-uio"' in node}
    assert registers == {"skymosaic", "dma_video", "dma_features", "dma_matches"}
    buffers = {name: node for name, node in nodes.items() if 'compatible = "ikwzm,u-dma-buf"' in node}
    assert buffers.keys() == {"udmabuf-frame", "udmabuf-features", "udmabuf-matches"}
    assert f"size = <{64 << 20:#x}>;" in buffers["udmabuf-frame"]
    assert ("skymosaic-ports" in nodes) == (cells == 2)
    (tmp_path / "skymosaic.hwh").write_text(hwh.replace("dma_matches", "other"))
    result = subprocess.run(command, capture_output=True, text=True, check=False)
    assert result.returncode == 2
    assert "skymosaic.hwh: no registers of dma_matches" in result.stderr
