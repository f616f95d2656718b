"""What the table of the hardware tab says of a comparison."""

from sim.simulators.scoreboard import Coverage
from skymosaic.evaluation.hardware import Comparison
from skymosaic.panel.pages.hardware_tab import _list_times


def test_times_of_software_and_hardware_stand_side_by_side() -> None:
    coverage = Coverage(frames=2, features=(900, 100), sectors=16, matches=300)
    compared = Comparison(None, coverage, (308_200, 308_700), 0.5, 0.08, (640, 480), (), (), {})
    assert [(software, hardware) for _, software, hardware in _list_times(compared)] == [
        ("40 ms", "2.05 ms, one pixel per clock"),
        ("25", "488, each matched while the next comes in"),
        ("", "308,700 clocks, 2.06 ms"),
        ("", "1,500 clocks, 10.00 µs"),
        ("", "1.23 M clocks/s, both frames in 0.50 s"),
    ]
