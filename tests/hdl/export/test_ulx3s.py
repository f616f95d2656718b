"""What `export board ulx3s` writes, and what the open tools make of it."""

import json
import re
import shutil
from pathlib import Path

import pytest

from golden_model.config_file import load_config
from hdl.build import BUILDS
from hdl.export import ulx3s as export
from hdl.export.boards import SOURCES
from hdl.export.tools import BuildError
from hdl.lib.ecp5 import Ecp5
from skymosaic.cli.export import OWN_NAMES

BUILD = BUILDS["ulx3s"]
COUNTER = f"""module {export.TOP}(
  input clk_25mhz, input btn_fire1, input ftdi_txd, output ftdi_rxd, output [7:0] led, output wifi_gpio0);
  reg [15:0] count = 0;
  always @(posedge clk_25mhz) count <= btn_fire1 ? 0 : count + 1;
  assign led = count[15:8];
  assign ftdi_rxd = ftdi_txd;
  assign wifi_gpio0 = 1;
endmodule
"""
"""The ports of the top, and next to nothing between them."""


@pytest.mark.slow
@pytest.mark.needs("place_and_route")
def test_the_tools_make_a_bitstream_of_a_small_top_with_the_pins_of_the_board(tmp_path: Path) -> None:
    (tmp_path / "rtl").mkdir()
    (tmp_path / "rtl" / f"{export.TOP}.v").write_text(COUNTER)
    shutil.copy(SOURCES / "ulx3s" / "ulx3s.lpf", tmp_path)
    made = export.build_bitstream(tmp_path)
    assert made["bytes"] == (tmp_path / "build" / "skymosaic.bit").stat().st_size > 100_000
    assert made["clock_mhz"] > 100
    assert made["TRELLIS_IO"][0] == 13


def test_the_export_has_what_its_readme_names(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # The Verilog takes long; it is simulated in another test.
    monkeypatch.setattr(export, "Ulx3s", lambda build: None)
    monkeypatch.setattr(export, "to_verilog", lambda top, **options: str(type(options["platform"]) is Ecp5))
    export.export_ulx3s(tmp_path, BUILD)
    found = {str(path.relative_to(tmp_path)) for path in tmp_path.rglob("*") if path.is_file()}
    host = ("serial_bus", "serve_serial", *(f"skymosaic_{name}" for name in ("driver", "map", "registers", "server")))
    assert found == {
        *("README.md", "ulx3s.lpf", "config.toml", f"rtl/{export.TOP}.v", *(f"host/{name}.py" for name in host)),
        *("LICENSE", "NOTICE"),
        *(f"registers/{name}" for name in ("register_map.md", "skymosaic.svd", "skymosaic_registers.h")),
    }
    assert all(re.fullmatch(OWN_NAMES, Path(name).parts[0]) for name in (*found, "build/skymosaic.bit"))
    # The Verilog is made for the ECP5.
    assert (tmp_path / "rtl" / f"{export.TOP}.v").read_text().endswith("\nTrue")
    assert load_config(tmp_path / "config.toml") == BUILD.config
    readme = (tmp_path / "README.md").read_text()
    named = {
        name for cell in re.findall(r"^\| (`.*?) \|", readme, re.MULTILINE) for name in re.findall("`(.*?)`", cell)
    }
    assert len(named) > 4
    # The bitstream is built by another test.
    assert {name for name in named if not (tmp_path / name).exists()} == {"build/skymosaic.bit"}
    assert "Not yet run on a board" in readme
    # Ten bits for each pixel of 320x240, at 25 MHz.
    assert all(told in readme for told in ("has 1,000,000 baud", "takes 0.77 s on", "3.1 ms per frame"))
    assert all(f"\n{tool} " in readme for tool, *_ in export.STEPS)
    # Every port has a pin.
    pins = (tmp_path / "ulx3s.lpf").read_text()
    ports = {"clk_25mhz", "btn_fire1", "ftdi_txd", "ftdi_rxd", "wifi_gpio0", *(f"led[{n}]" for n in range(8))}
    assert all(f'LOCATE COMP "{port}" SITE' in pins for port in ports)


def test_a_missing_tool_is_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(export, "STEPS", (("no-such-tool",),))
    with pytest.raises(BuildError, match=r"no-such-tool is not installed; .*\.\[ulx3s\]"):
        export.build_bitstream(tmp_path)


@pytest.mark.parametrize(("mhz", "builds"), [(25.04, True), (24.96, False)])
def test_what_the_tools_report_is_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, mhz: float, builds: bool
) -> None:
    monkeypatch.setattr(export, "STEPS", ())
    (tmp_path / "build").mkdir()
    (tmp_path / "build" / "skymosaic.bit").write_bytes(bytes(123))
    cells = {"TRELLIS_IO": {"used": 13, "available": 365}, "DCCA": {"used": 0, "available": 56}}
    report = {"fmax": {"$glbnet$clk": {"achieved": mhz, "constraint": 25}}, "utilization": cells}
    (tmp_path / "build" / "report.json").write_text(json.dumps(report))
    if builds:
        assert export.build_bitstream(tmp_path) == {"bytes": 123, "clock_mhz": 25.0, "TRELLIS_IO": (13, 365)}
        return
    with pytest.raises(BuildError, match=r"reaches 24\.96 MHz, less than the board's 25; make it smaller"):
        export.build_bitstream(tmp_path)
