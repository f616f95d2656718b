"""A board whose build estimates homographies: driver, server and client, as in `test_board`."""

import dataclasses
import threading
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from golden_model.config import PRESETS, EstimatorConfig
from sim.backends import board
from sim.backends.interface import BUILT_LANES, load_backend
from sim.benches.exported import host_programs
from sim.benches.pynq_board import open_board
from sim.benches.pynq_package import remove_pynq
from sim.scene import make_pair
from sim.simulators.accelerator_designs import BUILT_SIZES_PX

SIZE_PX = (160, 120)
CONFIG = dataclasses.replace(PRESETS["aerial"], estimator=EstimatorConfig(passes=2, seed=3, min_cells=2))
BUILD = {"lanes": BUILT_LANES, "max_width_px": BUILT_SIZES_PX[0][0], "max_height_px": BUILT_SIZES_PX[0][1]}
pytestmark = [pytest.mark.needs("pynq"), pytest.mark.slow]


def test_the_board_gives_the_golden_homographies(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(board, "TIMEOUT_SECONDS", None)
    images = [np.ascontiguousarray(image[..., 1]) for image in make_pair(seed=9, size=SIZE_PX).images]
    golden = load_backend("golden").run(images, CONFIG)
    system = open_board(CONFIG)
    with host_programs("pynq", CONFIG, **BUILD) as load:
        overlay: Any = load("pynq_overlay")
        overlay.LOCK = tmp_path / "lock"
        errors = load("skymosaic_registers")
        device = load("skymosaic_driver").Accelerator(load("pynq_bus").PynqBus("skymosaic.bit"), 60)
        with load("skymosaic_server").Server(("127.0.0.1", 0), device) as server:
            thread = threading.Thread(target=server.serve_forever)
            thread.start()
            client = load_backend(f"board:127.0.0.1:{server.server_address[1]}")
            found = client.run(images, CONFIG)
            plain = client.run(images, dataclasses.replace(CONFIG, estimator=None))
            # A record that nobody has taken does not reach the next run.
            device._received["features"].device_address = 0
            with pytest.raises(errors.AcceleratorError, match="features"):
                device.run(images, {}, hold_reference=True)
            server.shutdown()
            thread.join()
    system.bench.close()
    remove_pynq()
    assert [each.homography for each in found] == [each.homography for each in golden]
    assert golden[1].homography is not None
    assert golden[1].homography["inliers"] > 12
    assert [each.homography for each in plain] == [None, None]
