"""A board whose build estimates homographies: driver, server and client, as in `test_board`."""

import dataclasses
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sim.backends.errors import BackendError
from sim.benches.exported import host_programs
from skymosaic.features import board_client
from skymosaic.features.backends import load_backend
from tests.hdl.test_accelerator import BUILD, CONFIG, views
from tests.system.board.pynq_board import AcceleratorSystem, open_board
from tests.system.board.pynq_package import remove_pynq

HOMOGRAPHIES = "m_axis_homographies"
pytestmark = pytest.mark.needs("pynq")


@contextmanager
def serving(server: Any) -> Iterator[None]:
    """Have the server answer meanwhile."""
    thread = threading.Thread(target=server.serve_forever)
    thread.start()
    try:
        yield
    finally:
        server.shutdown()
        thread.join()


def use_40_bits(system: AcceleratorSystem, device: Any, patch: pytest.MonkeyPatch) -> None:
    """Build the DMA of the homographies for more addresses."""
    patch.setattr(system.receiving[HOMOGRAPHIES].receive, "address_bits", 40)
    dma, _ = device.bus._transfers._dmas["homographies"]
    patch.setitem(dma.description["parameters"], "c_addr_width", "40")


def test_the_board_gives_the_golden_homographies(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Also where the run before has ended early, and none where none is wanted.

    The record is so small that the board's system would allocate it beyond what a DMA with 32 address bits reaches.
    """
    monkeypatch.setattr(board_client, "TIMEOUT_SECONDS", None)
    images = views(2)
    system = open_board(BUILD)
    with host_programs(BUILD) as load:
        overlay: Any = load("pynq_overlay")
        overlay.LOCK = tmp_path / "lock"
        device = load("skymosaic_driver").Accelerator(load("pynq_bus").PynqBus("skymosaic.bit"))
        with load("skymosaic_server").Server(("127.0.0.1", 0), device) as server, serving(server):
            client = load_backend(f"board:127.0.0.1:{server.server_address[1]}")
            found = client.run(images, CONFIG, reference="previous")
            with monkeypatch.context() as patch:
                patch.setattr(device._received["homographies"], "device_address", 0)
                with pytest.raises(BackendError, match="DMA of the homographies reports a decode error"):
                    client.run(images, CONFIG)
            with monkeypatch.context() as patch:
                high = system.board.allocate((64,), np.uint8)
                patch.setitem(device._received, "homographies", high)
                with pytest.raises(BackendError, match="homographies lies at 0x870000000, beyond the 32 address bits"):
                    client.run(images, CONFIG)
                use_40_bits(system, device, patch)
                again = client.run(images, CONFIG, reference="previous")
            assert high.any()
            plain = client.run(images, dataclasses.replace(CONFIG, estimator=None))
    system.bench.close()
    remove_pynq()
    golden = load_backend("golden").run(images, CONFIG, reference="previous")
    expected = [each.homography for each in golden]
    assert [each.homography for each in found] == expected
    assert [each.homography for each in again] == expected
    assert [each.homography for each in plain] == [None] * len(images)
    assert expected[1] is not None
    assert expected[1]["inliers"] > 12
