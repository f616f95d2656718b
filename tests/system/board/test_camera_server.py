"""A camera build served by a board to a program elsewhere, the two apart: other processes and other modules.

The board has Python's library, NumPy and the export; nothing else can be imported there. The camera is a stand-in.
"""

import ast
import socket
import subprocess
import sys
import textwrap
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hdl.export.host import write_host
from sim.benches.exported import host_programs
from tests.system.board.test_painter_driver import PAINTING

BOARD = """
    import sys
    sys.path[:0] = [{folder!r}]
    import os
    allowed = {{name.removesuffix(".py") for name in os.listdir({folder!r})}} | {{"numpy", *sys.stdlib_module_names}}
    class Only:
        def find_spec(self, name, path=None, target=None):
            if name.split(".")[0] not in allowed:
                raise ImportError(f"{{name}} is not on the board")
    sys.meta_path.insert(0, Only())
    import numpy as np
    import skymosaic_camera_server as served
    from skymosaic_server import Server
    import skymosaic_map as maps
    class Frame:
        number, good = 7, True
        features, matches = np.zeros(3, maps.FEATURE), np.zeros(0, maps.MATCH)
        homography = np.zeros(1, maps.HOMOGRAPHY)[0]
    class Rings:
        registers = None
        def __init__(self, bus, settings, **options):
            self.left = settings["frames"]
            if not self.left:
                raise ValueError("frames is 0")
        def next_frame(self, seconds):
            self.left -= 1
            return Frame() if self.left >= 0 else None
        def release(self): pass
        def counts(self): return {{"dropped": 5}}
        def close(self): print("rings closed", flush=True)
    class Painter:
        def __init__(self, registers, columns): self.columns, self.followed = columns, 0
        def start(self): pass
        def follow(self, frame): self.followed += 1
        def anchor(self, number, pose): return number == 7 and pose[0, 2] == 2.5
        place = anchor
        def picture(self): return np.full((32, 32 * self.columns, 4), self.followed, np.uint8)
        def counts(self): return {{"frames_painted": self.followed}}
        def close(self): print("painter closed", flush=True)
    served.RingReader, served.Painter = Rings, Painter
    with Server(("127.0.0.1", 0), None, idle_seconds=3, handler=served.CameraSession) as server:
        print(server.server_address[1], flush=True)
        server.serve_forever()
"""


@pytest.fixture
def board(tmp_path: Path) -> Iterator[Any]:
    write_host(tmp_path, PAINTING)
    program = textwrap.dedent(BOARD).format(folder=str(tmp_path))
    with subprocess.Popen([sys.executable, "-I", "-c", program], stdout=subprocess.PIPE, text=True) as process:
        try:
            yield process
        finally:
            process.kill()


def test_a_program_elsewhere_has_frames_and_pictures(board: Any) -> None:
    address = ("127.0.0.1", int(board.stdout.readline()))
    with host_programs(PAINTING) as load:
        module = load("skymosaic_camera")
        with module.Camera({"frames": 2}, {"columns": 3}, address=address) as camera:
            frames = list(camera)
            assert [(frame.number, frame.good, len(frame.features)) for frame in frames] == [(7, True, 3)] * 2
            assert frames[0].homography["causes"] == 0
            pose = np.array([[1, 0, 2.5], [0, 1, 0], [0, 0, 1]])
            assert [camera.anchor(7, pose), camera.anchor(8, pose), camera.place(7, pose)] == [True, False, True]
            assert (camera.picture() == 2).all()
            assert camera.picture().shape == (32, 96, 4)
            assert camera.counts() == {"dropped": 5, "frames_painted": 2}
        assert [board.stdout.readline() for _ in range(2)] == ["painter closed\n", "rings closed\n"]
        # Without a painter; and a client that goes away in a request.
        with module.Camera({"frames": 1}, address=address) as camera:
            assert len(list(camera)) == 1
            with pytest.raises(module.CameraError, match="nothing is painted"):
                camera.picture()
        assert board.stdout.readline() == "rings closed\n"
        with socket.create_connection(address) as peer:
            peer.sendall(b'{"call": "start", "settings": {"frames": 1}, "rings": {}, "painter": {}}\n{"call')
            # Silent in a request, for longer than it may be.
            while said := peer.recv(1000):
                assert b"error" not in said
        assert [board.stdout.readline() for _ in range(2)] == ["the client has gone\n", "rings closed\n"]
        for settings, message in (({"frames": 0}, "frames is 0"), ({}, "frames")):
            with pytest.raises(module.CameraError, match=message):
                module.Camera(settings, address=address)
        board.kill()
        board.wait()
        with pytest.raises(module.CameraError, match="run serve_camera"):
            module.Camera({}, address=address)


def test_what_runs_on_the_board_is_python_3_10(tmp_path: Path) -> None:
    write_host(tmp_path, PAINTING)
    for path in tmp_path.glob("*.py"):
        ast.parse(path.read_text(), path.name, feature_version=(3, 10))
