"""A short flight through the whole camera build, by way of the bench: every record of every frame equals the model."""

import json

import cv2
import pytest

from bench import camera
from sim.scene import make_lawnmower

SIZE_PX = (160, 120)
FRAMES = 16


@pytest.mark.slow
def test_a_flight_and_a_host_that_pauses(monkeypatch: pytest.MonkeyPatch) -> None:
    # Nine frames come meanwhile, and the rings have eight slots.
    monkeypatch.setattr(camera, "PAUSE_EVERY", 4)
    images = make_lawnmower(2, FRAMES, SIZE_PX, forward_overlap=0.9).images
    flight = [cv2.cvtColor(images[n], cv2.COLOR_BGR2GRAY) for n in range(FRAMES)]
    figures = camera.fly(flight, SIZE_PX, seed=2)
    delivered = figures["delivered"]
    assert figures["of these, equal to the golden model in every record"] == delivered < FRAMES
    assert figures["reported as dropped"] == figures["really missing"] == FRAMES - delivered
    assert figures["the chip's homographies, accepted"] > delivered // 2
    answered = figures["homographies answered"]
    assert figures["of these answers, equal to the golden model"] == answered > 10 * delivered
    assert (figures["the chip's homographies, lost"], figures["AXI rules broken"]) == (0, 0)
    assert json.loads(json.dumps(figures)) == figures, "they are written to a file"
