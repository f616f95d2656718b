"""The benches of `sim.cocotb` at the AXI boundary of the Verilog, on every simulator that is installed."""

from pathlib import Path
from xml.etree import ElementTree

import pytest

from sim.cocotb import runner

ICARUS = pytest.mark.needs("icarus")
RUNS = [
    *(("verilator", cases) for cases in runner.CASES),
    # Some hundred cycles per second. `tests/system/test_export_tools.py` runs a shorter bench in Icarus.
    *(pytest.param("icarus", cases, marks=[ICARUS, pytest.mark.slow]) for cases in runner.CASES),
]


@pytest.mark.parametrize(("simulator", "cases"), RUNS)
def test_every_case_passes(tmp_path: Path, simulator: str, cases: str) -> None:
    results = runner.run(f"sim.cocotb.{cases}", tmp_path, simulator=simulator, progress=print)
    assert len(list(ElementTree.parse(results).iter("testcase"))) >= 3


def test_a_case_that_fails_is_found_out(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "failing.py").write_text(
        "import cocotb\nfrom sim.cocotb.bench import Bench\n\n"
        "@cocotb.test()\nasync def wrong_identity(dut):\n"
        "    bench = Bench(dut)\n    await bench.start()\n    assert await bench.read('identity') == 0\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(SystemExit):
        runner.run("failing", tmp_path)
