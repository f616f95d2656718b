from pathlib import Path

import numpy as np
import pytest

from golden_model.config_file import load_config
from sim.backends.errors import BackendError
from sim.backends.interface import silent
from sim.simulators.hardware import HardwareBackend


def test_what_only_the_blocks_know_to_be_impossible_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "c.toml").write_text('preset = "thesis"\n[front_end]\nborder_px = 5\ndescriptor = "thesis-ilbp-1"\n')
    frames = [np.zeros((64, 64), np.uint8)] * 2
    with pytest.raises(BackendError, match=r"^the hardware cannot be built: border_px is 5; .* needs 6$"):
        HardwareBackend(progress=silent, waves=None).run(frames, load_config(tmp_path / "c.toml"))
