"""A rendered flight, as pictures in memory and as files in a folder; the command line in the test's process."""

import sys
from pathlib import Path

import cv2
import pytest

from sim.scene import Flight, lawnmower
from skymosaic.cli import main

IMAGES, SIZE = 9, (480, 360)


@pytest.fixture(scope="session")
def flight() -> Flight:
    return lawnmower(seed=5, images=IMAGES, size=SIZE, forward_overlap=0.6, side_overlap=0.4)


@pytest.fixture(scope="session")
def folder(tmp_path_factory: pytest.TempPathFactory, flight: Flight) -> Path:
    folder = tmp_path_factory.mktemp("flight")
    for index, image in enumerate(flight.images):
        cv2.imwrite(str(folder / f"{index}.png"), image)
    return folder


@pytest.fixture
def run(tmp_path: Path, capfdbinary: pytest.CaptureFixture[bytes], monkeypatch: pytest.MonkeyPatch):
    """Exit status, standard output and standard error of a command in the temporary folder."""
    monkeypatch.chdir(tmp_path)

    def command(*words: str) -> tuple[int, bytes, str]:
        monkeypatch.setattr(sys, "argv", ["skymosaic", *words])
        with pytest.raises(SystemExit) as end:
            main()
        printed = capfdbinary.readouterr()
        return int(end.value.code or 0), printed.out, printed.err.decode()

    return command
