import subprocess
import sys
from pathlib import Path

# In a process of its own: Amaranth warns of blocks that are made and not used, whenever they are collected.
RUN = """
import numpy as np
from golden_model.config_file import load_config
from sim.backends.interface import silent
from sim.simulators.hardware import HardwareBackend
frames = [np.zeros((64, 64), np.uint8)] * 2
HardwareBackend(progress=silent, waves=None).run(frames, load_config("c.toml"))
"""


def test_what_only_the_blocks_know_to_be_impossible_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "c.toml").write_text('preset = "thesis"\n[front_end]\nborder_px = 5\ndescriptor = "thesis-ilbp-1"\n')
    run = subprocess.run([sys.executable, "-c", RUN], check=False, cwd=tmp_path, capture_output=True, text=True)
    assert "BackendError: the hardware cannot be built: border_px is 5; with this detector and " in run.stderr
