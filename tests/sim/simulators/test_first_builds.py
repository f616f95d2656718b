"""First builds with the real compiler: one that is killed, then two at once."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

BUILD = """
from sim.simulators import verilator
from tests.sim.simulators.test_simulators import DESIGN, random_images, segment

verilator.build_library(DESIGN, progress=lambda line: print(line, flush=True))
(recording,) = verilator.simulate(DESIGN, [segment(random_images(2), bias=7)])
print("ends", recording.outputs["m_axis_difference"].ends.tolist(), flush=True)
"""


def start(cache: Path) -> subprocess.Popen[str]:
    environment = {**os.environ, "XDG_CACHE_HOME": str(cache), "PYTHONPATH": str(Path(__file__).parents[3])}
    command = [sys.executable, "-c", BUILD]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, env=environment)


@pytest.mark.slow
def test_a_killed_first_build_and_two_at_once(tmp_path: Path) -> None:
    killed = start(tmp_path)
    assert killed.stdout
    while "compiled 1 of" not in (line := killed.stdout.readline()):
        assert line, "the build ended before it could be killed"
    killed.send_signal(signal.SIGKILL)
    killed.communicate()
    assert list((tmp_path / "skymosaic").glob("verilator-*.part"))
    assert not list((tmp_path / "skymosaic").glob("verilator-*/simulator.so"))

    both = [start(tmp_path) for _ in range(2)]
    outputs = [process.communicate()[0] for process in both]
    assert [process.returncode for process in both] == [0, 0], outputs
    said = "".join(outputs)
    # One of them compiles, and the other one waits for it or finds it done.
    assert said.count("built row difference for") == 1, said
    ends = [line for line in said.splitlines() if line.startswith("ends")]
    assert len(ends) == 2, said
    assert ends[0] == ends[1]
    assert not list((tmp_path / "skymosaic").glob("*.part"))
