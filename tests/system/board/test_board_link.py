"""The link to a board under attack, from both sides."""

import argparse
import json
import re
import socket
import sys
import time
from collections.abc import Callable
from contextlib import AbstractContextManager
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from golden_model.config import Config, EstimatorConfig, MatcherConfig
from golden_model.fuzzy.rules import MatchRules, read_shipped
from golden_model.records import FRAME_STATUS
from hdl.settings import REQUESTED
from sim.backends.errors import BackendError
from sim.backends.interface import FrameResult
from skymosaic.features.backends import load_backend
from tests.system.board.conftest import CONFIG, FEATURE, Serve

OF_OTHERS = ("0.0.0.0", "", "192.0.2.1", "board.example", "::")
"""Addresses that others could reach."""
FRAME = np.zeros((64, 96), np.uint8)
STATUS_BYTES = FRAME_STATUS.dtype.itemsize


def run(address: str, frames: int = 2) -> list[FrameResult]:
    return load_backend(f"board:{address}").run([FRAME] * frames, CONFIG)


def exchange(address: str, data: bytes) -> dict[str, object]:
    host, port = address.split(":")
    with socket.create_connection((host, int(port))) as connection:
        connection.sendall(data)
        return json.loads(connection.makefile("rb").readline())


def request(**changed: Any) -> bytes:
    settings = dict.fromkeys(REQUESTED, 0) | {"width_px": 96, "height_px": 64, "cell_log2": 5, "per_cell": 5}
    settings |= changed.pop("settings", {})
    rules = CONFIG.matcher.rules_digest(CONFIG.front_end.pattern)
    values = {"shape": [64, 96], "frames": 1, "settings": settings, "hold_reference": True, "rules_digest": rules}
    values |= changed
    return json.dumps(values).encode() + b"\n"


def test_a_board_with_other_rules_is_refused(serve: Serve) -> None:
    other = Config(front_end=CONFIG.front_end, matcher=MatcherConfig(rule_base="none"))
    with serve() as (device, address):
        with pytest.raises(BackendError, match="the request is for 00000000; export again with these --rules"):
            load_backend(f"board:{address}").run([FRAME, FRAME], other)
        # Rules that decide as the built ones do, whatever they are called.
        text = read_shipped("aerial").replace("low", "near")
        same = Config(front_end=CONFIG.front_end, matcher=MatcherConfig(rule_base=MatchRules(text)))
        assert len(load_backend(f"board:{address}").run([FRAME, FRAME], same)) == 2
        assert device.frames == 2


@pytest.mark.parametrize(
    ("data", "says"),
    [
        (b"[" * 60_000 + b"\n", "malformed"),
        (b"\xff\xfe\n", "malformed"),
        (b"1" * 70_000, "longer than 65536"),
        (b"9" * 5000 + b"\n", "malformed"),
        (request(shape=[64.0, 96]), "malformed"),
        (request(shape="ab"), "malformed"),
        (request(frames=True), "malformed"),
        (request(hold_reference="no"), "malformed"),
        (request(frames=1000), "1 to 64"),
        (request(shape=[1 << 40, 96]), "differ"),
        (request(shape=[1 << 40, 96], settings={"height_px": 1 << 40}), "height_px is 1099511627776"),
        (request(shape=[64, 96, 3, 3]), "must be"),
        (request(settings={"per_cell": 200}), "per_cell is 200"),
        (request(settings={"detector": -1}), "detector is -1"),
        (request(settings={"threshold_code": 1 << 40}), "threshold_code"),
        (request(settings={"width_px": 97}), "differ"),
        (request(homographies=1), "malformed"),
        (request(homographies=True), "malformed"),
        (request(homographies=True, settings=vars(EstimatorConfig())), "estimates no homographies; export again"),
    ],
)
def test_a_bad_request_is_answered_in_one_line(serve: Serve, data: bytes, says: str) -> None:
    with serve() as (device, address):
        assert says in str(exchange(address, data)["error"])
        assert device.frames == 0
        assert len(run(address)) == 2


def test_a_slow_client_does_not_keep_the_board(serve: Serve) -> None:
    with serve(idle_seconds=0.3, request_seconds=1.0) as (_, address):
        host, port = address.split(":")
        with socket.create_connection((host, int(port))):  # sends nothing
            assert len(run(address)) == 2
        with socket.create_connection((host, int(port))) as drip:
            drip.sendall(request(frames=64))
            with pytest.raises((BrokenPipeError, ConnectionResetError)):
                send_slowly(drip)
        assert len(run(address)) == 2


def send_slowly(connection: socket.socket) -> None:
    for _ in range(200):
        connection.sendall(b"x")
        time.sleep(0.1)


def test_an_error_of_the_accelerator_reaches_a_client_that_still_sends(
    serve: Serve, monkeypatch: pytest.MonkeyPatch
) -> None:
    with serve() as (device, address):
        monkeypatch.setattr(device, "run", lambda frames, settings, hold_reference: next(iter(frames)) and None)
        with pytest.raises(BackendError, match="reports: The truth value"):
            run(address, 20)


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("--port", "{used}"), r"cannot listen on 127.0.0.1:\d+: .*in use"),
        (("--port", "99999"), "cannot listen on 127.0.0.1:99999: .*0-65535"),
        *((("--host", host), f"others could use the board at '{host}'; .* SSH tunnel") for host in OF_OTHERS),
        (("--tty", "absent"), "could not open port absent"),
    ],
)
def test_a_server_that_cannot_start_says_why_in_one_line(
    server_module: ModuleType,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    words: tuple[str, ...],
    says: str,
) -> None:
    def open_accelerator(options: argparse.Namespace) -> None:
        if options.tty:
            # As pyserial does.
            raise OSError(2, f"could not open port {options.tty}: No such file or directory")

    with socket.create_server(("127.0.0.1", 0)) as used:
        port = used.getsockname()[1]
        monkeypatch.setattr(sys, "argv", ["serve.py", *(word.format(used=port) for word in words)])
        parser = server_module.options_parser("serves")
        parser.add_argument("--tty")
        with pytest.raises(SystemExit) as ended:
            server_module.serve(parser, open_accelerator)
    assert ended.value.code == 2
    usage, error = capsys.readouterr().err.split("serve.py: error: ")
    assert usage.startswith("usage: ")
    assert re.fullmatch(f".*{says}.*\n", error)


@pytest.mark.parametrize(
    ("answer", "says"),
    [
        (b"HTTP/1.1 200 OK\r\n\r\n", "not come from a board"),
        (b"[" * 60_000 + b"\n", "not come from a board"),
        (b"7\n", "not come from a board"),
        (b"", "not come from a board"),
        (b'{"error": "\\u001b[2J\\nforged line"}\n', r"reports: \\x1b\[2J\\nforged line"),
        (b'{}\n{"lengths": "many"}\n', "other packets"),
        (b'{}\n{"lengths": [0]}\n', "other packets"),
        (b'{}\n{"lengths": [true, 1, 1, 1]}\n', "other packets"),
        (b'{}\n{"lengths": [1000000000, 32, 0, 32]}\n', "invalid length"),
        (b'{}\n{"lengths": [-8, 32, 0, 32]}\n', "invalid length"),
        (f'{{}}\n{{"lengths": [1, {STATUS_BYTES}, 0, {STATUS_BYTES}]}}\n'.encode(), "other records"),
        (f'{{}}\n{{"lengths": [0, {STATUS_BYTES}, 0, {STATUS_BYTES}]}}\nxyz'.encode(), "in the middle"),
        (
            f'{{}}\n{{"lengths": [{FEATURE.itemsize}, {STATUS_BYTES}, 0, {STATUS_BYTES}]}}\n'.encode() + bytes(500),
            "without a frame's status",
        ),
    ],
)
def test_a_broken_peer_is_one_line(
    answering: Callable[[bytes], AbstractContextManager[str]], answer: bytes, says: str
) -> None:
    with answering(answer) as address, pytest.raises(BackendError, match=says) as caught:
        run(address, 1)
    assert "\n" not in str(caught.value)
