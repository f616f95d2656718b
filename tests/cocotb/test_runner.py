"""The benches of `tests.cocotb` at the AXI boundary of the Verilog: all cases on Verilator, some on Icarus, too."""

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from xml.etree import ElementTree

import pytest

from tests.cocotb import runner

ON_ICARUS = {
    "frames": ("gray_video_of_an_odd_size_with_random_stalls", "gray_memory_of_an_odd_size_with_random_stalls"),
    "faults": ("clear_in_mid_frame",),
    "settings": ("size_and_mode_written_in_mid_frame",),
    "access": ("four_hundred_random_accesses", "the_interrupt_marks_the_end_of_a_packet"),
}
"""Icarus takes a minute for a frame or two, and knows unknown bits, which Verilator does not. These cases show them
where they might come out: in registers, in stalls at an odd size, after a clear and the malformed frame that it
leaves, and after sizes and modes written in mid-frame, colour among them."""


def run(cases: Sequence[str], folder: Path, simulator: str, *only: str) -> list[str]:
    """Run the cases of modules, or only some; the names of those that were run."""
    modules = [f"tests.cocotb.{each}" for each in cases]
    results = runner.run(modules, folder, only=only or None, simulator=simulator, progress=print)
    return [f"{case.get('classname')}.{case.get('name')}" for case in ElementTree.parse(results).iter("testcase")]


def test_every_case_passes(tmp_path: Path) -> None:
    """In one simulation: every case resets, and the landscape is rendered once."""
    found = Counter(name.split(".")[-2] for name in run(runner.CASES, tmp_path, "verilator"))
    assert found.keys() == set(runner.CASES)
    assert min(found.values()) >= 3


@pytest.mark.slow
@pytest.mark.needs("icarus")
@pytest.mark.parametrize("cases", ON_ICARUS)
def test_chosen_cases_pass_on_icarus(tmp_path: Path, cases: str) -> None:
    found = run([cases], tmp_path, "icarus", *ON_ICARUS[cases])
    assert sorted(name.split(".")[-1] for name in found) == sorted(ON_ICARUS[cases])


def test_a_case_that_fails_is_found_out(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "failing.py").write_text(
        "import cocotb\nfrom tests.cocotb.bench import Bench\n\n"
        "@cocotb.test()\nasync def wrong_identity(dut):\n"
        "    bench = await Bench.open(dut)\n    assert await bench.read('identity') == 0, 'not 0'\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(SystemExit):
        runner.run("failing", tmp_path)
    assert "not 0" in (tmp_path / "results.xml").read_text()
